"""clocks of workers

Revision: clocks, after deadlines
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "clocks"
down_revision = "deadlines"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("workers", sa.Column("clock_ahead", sa.Float(), nullable=True))
