"""a third input of products, evaluations behind a distorting sensor

Revision: 0002
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("products") as batch_op:
        batch_op.add_column(sa.Column("input_c", sa.String(length=32), nullable=True))
        batch_op.create_index(
            "ix_products_input_c",
            ["input_c"],
            sqlite_where=sa.text("input_c IS NOT NULL"),
            postgresql_where=sa.text("input_c IS NOT NULL"),
        )
    with op.batch_alter_table("evaluations") as batch_op:
        batch_op.add_column(sa.Column("distorted", sa.Boolean(), nullable=False, server_default=sa.false()))


def downgrade() -> None:
    # Not in batch mode: that would write the tables anew, and what hangs on their rows would go with the old ones.
    op.execute("ALTER TABLE evaluations DROP COLUMN distorted")
    op.drop_index("ix_products_input_c", table_name="products")
    op.execute("ALTER TABLE products DROP COLUMN input_c")
