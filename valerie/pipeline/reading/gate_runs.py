"""Reading of runs for the gate."""

from __future__ import annotations

from valerie.analysis.verdicts.gate import GateRun
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.base.run_artifacts import read_summary
from valerie.pipeline.reading.tables import read_table
from valerie.plain import typed


def read_gate_run(context: Context, run_id: str) -> GateRun:
    """Read an ended run.

    Raises:
        NotFound: no such run.
        Conflict: it has not ended, or its asset changed.
    """
    summary = read_summary(context, run_id)
    run = read_run(context, run_id)
    return GateRun(
        run_id,
        run.resolved.spec,
        run.resolved.asset_digest,
        run.pins,
        read_table(context.engine, run),
        typed(tuple[RequirementVerdict, ...], summary["verdicts"]),
    )
