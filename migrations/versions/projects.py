"""projects of runs, studies, saved selections and tokens; tenants of runs

Revision: projects, after removed_frames
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from valerie.db.models import NAMING

revision = "projects"
down_revision = "removed_frames"
branch_labels = None
depends_on = None


def upgrade() -> None:
    for table, column in (("runs", "project"), ("runs", "tenant"), ("studies", "project"), ("tokens", "project")):
        op.add_column(table, _names(column))
    with op.batch_alter_table("selections", naming_convention=NAMING) as selections:
        selections.add_column(_names("project"))
        selections.drop_constraint("pk_selections", type_="primary")
        selections.create_primary_key("pk_selections", ["project", "name"])


def _names(column: str) -> sa.Column[str]:
    return sa.Column(column, sa.String(length=64), server_default="", nullable=False)
