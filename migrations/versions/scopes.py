"""scopes of tokens

Revision: scopes, after quotas
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "scopes"
down_revision = "quotas"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("tokens", sa.Column("scopes", sa.String(length=400), server_default="", nullable=False))
