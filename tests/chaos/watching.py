"""What a schedule observes in the database: progress, and every row that is published."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import Engine, func, select, text

from valerie.db.engine import open_database, reading
from valerie.db.models import Base, Product, Run
from valerie.errors import TransientError
from valerie.runs.products.states import ProductState, RunState

_POLL_SECONDS = 0.05
_OPEN = (RunState.RUNNING, RunState.PAUSED, RunState.FINISHING)
_ON_POSTGRES = """
CREATE FUNCTION note_published() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  INSERT INTO published SELECT TG_TABLE_NAME, string_agg(to_jsonb(NEW) ->> name, ' '), NEW::text FROM unnest(TG_ARGV) AS name;
  RETURN NEW; END $$
"""


@dataclass
class Happened:
    """A fault of a schedule.

    Attributes:
        name: of the fault.
        share: share of the products after which it begins.
        began, ended: monotonic seconds; 0 before.
        standstill: longest time without progress after it and before the next, seconds.
    """

    name: str
    share: float
    began: float = 0.0
    ended: float = 0.0
    standstill: float = 0.0

    @property
    def lasts(self) -> bool:
        return bool(self.began and not self.ended)


class Watcher:
    """Thread that counts the products done, and measures how long none was finished while no fault lasted.

    Attributes:
        done, state: number of finished products, and state of the run, at the latest look.
        calm_standstill: longest time without progress before the first fault, seconds.
    """

    def __init__(self, url: str, run_id: str, faults: Sequence[Happened]) -> None:
        self._engine, self._run_id, self._faults = open_database(url), run_id, faults
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watcher", daemon=True)
        self.done, self.calm_standstill = 0, 0.0
        self.state: RunState | None = None

    def __enter__(self) -> Watcher:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()
        self._engine.dispose()

    def _run(self) -> None:
        count = select(func.count()).where(Product.state == ProductState.DONE)
        state = select(Run.state).where(Run.id == self._run_id)
        seen, since = None, time.monotonic()
        while not self._stop.wait(_POLL_SECONDS):
            lasting = self._lasting()
            try:
                with reading(self._engine) as connection:
                    self.done, self.state = connection.scalar(count) or 0, connection.scalar(state)
            except TransientError:
                continue  # a look in peace follows
            look = time.monotonic()
            current = self.done, self.state
            if lasting or self._lasting() or self.state not in _OPEN or not self.done or seen != current:
                seen, since = current, look
                continue
            ended = [fault for fault in self._faults if fault.ended]
            gap = look - max([since, *(fault.ended for fault in ended)])
            if ended:
                latest = max(ended, key=lambda fault: fault.ended)
                latest.standstill = max(latest.standstill, gap)
            else:
                self.calm_standstill = max(self.calm_standstill, gap)

    def _lasting(self) -> bool:
        return any(fault.lasts for fault in self._faults)


def note_published(engine: Engine) -> None:
    """Have the database note every row that workers publish, with the key of the row."""
    with engine.begin() as connection:
        connection.execute(text('CREATE TABLE published ("table" TEXT, "key" TEXT, "row" TEXT)'))
        if engine.name == "postgresql":
            connection.execute(text(_ON_POSTGRES))
        for table in Base.metadata.sorted_tables:
            if not any(key.column.table.name == "products" for key in table.foreign_keys):
                continue
            keys = [column.name for column in table.primary_key]
            for moment in ("INSERT", "UPDATE"):
                head = f"CREATE TRIGGER {table.name}_{moment} AFTER {moment} ON {table.name}"
                if engine.name == "postgresql":
                    arguments = ", ".join(f"'{key}'" for key in keys)
                    connection.exec_driver_sql(f"{head} FOR EACH ROW EXECUTE FUNCTION note_published({arguments})")
                    continue
                key = " || ' ' || ".join(f'NEW."{name}"' for name in keys)
                row = " || ',' || ".join(f'quote(NEW."{column.name}")' for column in table.columns)
                connection.exec_driver_sql(
                    f"{head} BEGIN INSERT INTO published VALUES ('{table.name}', {key}, {row}); END"
                )


def contradictions(engine: Engine) -> list[str]:
    """Return the keys that were published with different rows."""
    query = 'SELECT "table", "key" FROM published GROUP BY 1, 2 HAVING count(DISTINCT "row") > 1 ORDER BY 1, 2'
    with reading(engine) as connection:
        return [f"{table} {key}" for table, key in connection.execute(text(query))]
