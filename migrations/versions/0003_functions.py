"""functions under test

Revision: 0003
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "functions",
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("digest", sa.String(length=32), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column(
            "document", sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql"), nullable=False
        ),
        sa.Column("payload", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("name", "digest", name=op.f("pk_functions")),
        sa.UniqueConstraint("name", "version", name=op.f("uq_functions_name_version")),
    )
    with op.batch_alter_table("functions", schema=None) as batch_op:
        batch_op.create_index("ix_functions_digest", ["digest"], unique=False)
        batch_op.create_index("ix_functions_payload", ["payload"], unique=False)


def downgrade() -> None:
    with op.batch_alter_table("functions", schema=None) as batch_op:
        batch_op.drop_index("ix_functions_payload")
        batch_op.drop_index("ix_functions_digest")

    op.drop_table("functions")
