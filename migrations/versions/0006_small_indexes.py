"""indexes of products: inputs of what waits only; what ended, for sums and recorded costs

Revision: 0006
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0003"
branch_labels = None
depends_on = None

_INPUTS = ("input_a", "input_b", "input_c")


def _create(name: str, columns: list[str], where: str | None) -> None:
    condition = None if where is None else sa.text(where)
    op.create_index(name, "products", columns, sqlite_where=condition, postgresql_where=condition)


def upgrade() -> None:
    for column in _INPUTS:
        op.drop_index(f"ix_products_{column}", table_name="products")
        _create(f"ix_products_{column}", [column], "state = 'waiting'")
    _create("ix_products_ended", ["kind", "state", "finished_at", "cpu_seconds"], "state IN ('done','failed')")


def downgrade() -> None:
    op.drop_index("ix_products_ended", table_name="products")
    for column in _INPUTS:
        op.drop_index(f"ix_products_{column}", table_name="products")
        _create(f"ix_products_{column}", [column], "input_c IS NOT NULL" if column == "input_c" else None)
