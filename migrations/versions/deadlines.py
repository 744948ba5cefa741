"""owners of products and their turns; deadlines of runs

Revision: deadlines, after specimens
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "deadlines"
down_revision = "specimens"
branch_labels = None
depends_on = None

_UNFINISHED = sa.text("state IN ('waiting','ready','running')")


def upgrade() -> None:
    op.add_column("runs", sa.Column("deadline", sa.DateTime(timezone=True), nullable=True))
    op.add_column("products", sa.Column("owner", sa.String(length=200), server_default="", nullable=False))
    op.drop_index("ix_products_unfinished", "products")
    op.create_index(
        "ix_products_unfinished",
        "products",
        ["state", "route", "owner", "turn"],
        sqlite_where=_UNFINISHED,
        postgresql_where=_UNFINISHED,
    )
    op.create_table(
        "owner_turns",
        sa.Column("route", sa.String(length=120), nullable=False),
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("start", sa.Float(), nullable=False),
        sa.Column("turn", sa.Float(), nullable=False),
        sa.PrimaryKeyConstraint("route", "owner", name="pk_owner_turns"),
    )
