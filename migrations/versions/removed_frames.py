"""why a run no longer keeps the pictures of a frame

Revision: removed_frames, after release_0_1_0
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "removed_frames"
down_revision = "release_0_1_0"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("frames", sa.Column("removed", sa.String(length=64), nullable=True))
