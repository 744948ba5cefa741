"""who submitted runs and studies, for quotas

Revision: 0004_owners
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004_owners"
down_revision = "0003_audit"
branch_labels = None
depends_on = None


def upgrade() -> None:
    for table in ("runs", "studies"):
        op.add_column(table, sa.Column("owner", sa.String(length=200), nullable=True))


def downgrade() -> None:
    for table in ("runs", "studies"):
        op.drop_column(table, "owner")
