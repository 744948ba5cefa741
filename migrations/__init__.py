"""The Alembic chain: one for SQLite and Postgres; the entry points run it (`valerie.db.migrate`)."""
