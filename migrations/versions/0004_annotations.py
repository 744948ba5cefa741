"""annotations of frames; bearing, aspect, light and contrast of persons

Revision: 0004
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "frame_annotations",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("variant_index", sa.BigInteger(), nullable=False),
        sa.Column("camera_index", sa.Integer(), nullable=False),
        sa.Column("time_index", sa.Integer(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("product", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(
            ["run_id", "variant_index", "camera_index", "time_index"],
            ["frames.run_id", "frames.variant_index", "frames.camera_index", "frames.time_index"],
            name="fk_frame_annotations_frame",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint(
            "run_id",
            "variant_index",
            "camera_index",
            "time_index",
            "kind",
            name=op.f("pk_frame_annotations"),
        ),
    )
    op.create_index("ix_frame_annotations_product", "frame_annotations", ["product"], unique=False)
    op.create_table(
        "person_lights",
        sa.Column("product", sa.String(length=32), nullable=False),
        sa.Column("instance_id", sa.Integer(), nullable=False),
        sa.Column("irradiance", sa.Float(), nullable=True),
        sa.Column("shadow_share", sa.Float(), nullable=True),
        sa.Column("contrast", sa.Float(), nullable=True),
        sa.ForeignKeyConstraint(
            ["product"], ["products.digest"], name=op.f("fk_person_lights_product"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("product", "instance_id", name=op.f("pk_person_lights")),
    )
    with op.batch_alter_table("person_views") as batch_op:
        batch_op.add_column(sa.Column("bearing_deg", sa.Float(), nullable=True))
        batch_op.add_column(sa.Column("aspect_deg", sa.Float(), nullable=True))


def downgrade() -> None:
    # Not in batch mode, as in 0002.
    op.execute("ALTER TABLE person_views DROP COLUMN aspect_deg")
    op.execute("ALTER TABLE person_views DROP COLUMN bearing_deg")
    op.drop_table("person_lights")
    op.drop_index("ix_frame_annotations_product", table_name="frame_annotations")
    op.drop_table("frame_annotations")
