"""what numeric classes make of a fixed scene or picture

Revision: specimens, after archives
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "specimens"
down_revision = "archives"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "specimens",
        sa.Column("key", sa.String(length=32), nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("key"),
    )
