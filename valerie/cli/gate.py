"""`valerie gate`: pass or fail a change, by the requirements of a run and by a baseline."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.option_documents import takes_documents
from valerie.cli.shell import (
    AsJson,
    DataDir,
    Exit,
    RunId,
    UrlOrFolder,
    decide,
    print_json,
    require_format,
    write_output,
)
from valerie.errors import NotFound, UnknownName
from valerie.local.terminal import console
from valerie.plain import typed

if TYPE_CHECKING:
    from rich.console import RenderableType

    from valerie.analysis.verdicts.gate import GateResult, GateRun


@dataclass(frozen=True, slots=True)
class BaselineOptions:
    """The baseline of a gate, and the comparison with it."""

    baseline: Annotated[
        str | None,
        typer.Option(
            "--baseline", metavar="RUN|FUNCTION", help="A run on the same frames, or another function of this run."
        ),
    ] = None
    function: Annotated[
        str | None, typer.Option("--function", metavar="NAME", help="Compare only this function with the baseline.")
    ] = None
    effect: Annotated[
        float,
        typer.Option(
            "--effect",
            min=0.001,
            max=0.999,
            help="Smallest drop of pACC to detect; decides how many places are needed.",
        ),
    ] = 0.05
    mixed: Annotated[
        bool, typer.Option("--mixed", help="Also compare functions that ran in unequal numeric classes.")
    ] = False


@dataclass(frozen=True, slots=True)
class PlacesOptions:
    """The question how many places a verdict will need."""

    before: Annotated[
        bool,
        typer.Option("--before", help="Only print how many places a verdict will need, with RUN as the baseline."),
    ] = False
    deviation: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1.0,
            help="With --before: standard deviation of a place's change.",
            show_default="as between two functions of the run",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class VerdictFiles:
    """Files that a gate writes."""

    junit: Annotated[
        Path | None,
        typer.Option("--junit", metavar="FILE", help="Also write JUnit XML; slices with too few places are skipped."),
    ] = None
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Also write the verdicts: FILE.csv, .parquet or .json."),
    ] = None

    def write(self, result: GateResult) -> None:
        """Write the requested files."""
        from valerie.analysis.verdicts.junit import junit_xml

        if self.junit is not None:
            write_output(self.junit, junit_xml(result))
        if self.output is not None:
            write_output(self.output, _verdicts(result, self.output.suffix))


@takes_documents
def gate(
    run_id: RunId,
    versions: BaselineOptions,
    places: PlacesOptions,
    files: VerdictFiles,
    allow_undecided: Annotated[
        bool, typer.Option("--allow-undecided", help="Let undecided requirements and comparisons pass.")
    ] = False,
    as_json: AsJson = False,
    url: UrlOrFolder = None,
    data_dir: DataDir = None,
) -> None:
    """Exit with 6 unless a run meets its requirements and is not worse than the baseline in any slice.

    Requirements that are not met or undecided fail. The baseline is compared on
    identical frames, slice by slice; at most 5 % of the slices reported as worse are
    expected to be false alarms. If even all rows together have too few places to
    show a drop, the comparison is undecided.
    """
    from valerie.analysis.verdicts.gate import gate as judge

    require_format(files.output, (".csv", ".parquet", ".json"))
    read = run_reader(url, data_dir)
    run = read(run_id)
    if places.before:
        _say_places(run, versions, places.deviation, as_json=as_json)
        return
    result = judge(
        run,
        _baseline(versions.baseline, run, read),
        function=versions.function,
        effect=versions.effect,
        mixed=versions.mixed,
        allow_undecided=allow_undecided,
    )
    files.write(result)
    code = decide(Exit.OK if result.passed else Exit.GATE_FAILED)
    if as_json:
        print_json(result.to_json())
    else:
        for part in renderables(result):
            console().print(part)
    raise typer.Exit(code)


def _baseline(reference: str | None, run: GateRun, read: Callable[[str], GateRun]) -> GateRun | str | None:
    """Return a function of the run by its name, or another run."""
    from valerie.analysis.verdicts.gate import called

    if reference is None or called(reference, run) is not None:
        return reference
    try:
        return read(reference)
    except NotFound:
        kind = "run, or function of the run,"
        raise UnknownName(kind, reference, run.spec.functions, field="--baseline") from None


def _say_places(run: GateRun, versions: BaselineOptions, deviation: float | None, *, as_json: bool) -> None:
    from rich.text import Text

    from valerie.analysis.verdicts.gate import places_before

    effect = versions.effect
    needs = places_before(run, function=versions.function, effect=effect, deviation=deviation)
    if as_json:
        print_json(list(map(asdict, needs)))
        return
    for need in needs:
        takes = "more places than any run has" if need.needed is None else f"{need.needed:,} places"
        text = (
            f"{need.function}: a drop of {100 * effect:g} points in one of {len(need.slices):,} slices takes {takes}, "
            f"if the change of a place deviates by {100 * need.deviation:.1f} points"
        )
        console().print(Text(text, style="bold"))
        for name, places in need.too_few.items():
            console().print(Text(f"  too few: {name}, {places:,} places", style="dim"))


def renderables(result: GateResult) -> list[RenderableType]:
    """Return a gate's result for a rich console: verdicts, then the slices that became worse, then all others."""
    from rich.text import Text

    from valerie.analysis.comparison.wording import undecided_text
    from valerie.analysis.verdicts.gate import slice_text
    from valerie.analysis.verdicts.text import verdicts_renderable
    from valerie.analysis.wording import ALIKE_PLACES

    parts: list[RenderableType] = [verdicts_renderable(result.verdicts), ""] if result.verdicts else []
    for version in result.versions:
        worse, slices = len(version.gate.worse), version.gate.slices
        few = {
            item.name: (item.places, item.places_needed, item.alike)
            for item in slices
            if item.too_few and not item.worse
        }
        head = f"{version.version} against {version.baseline}: "
        if version.undecided:
            head += "undecided"
        else:
            head += f"worse in {worse:,} of {len(slices):,} slices" if worse else "nowhere shown to be worse"
        if few:
            head += f"; {undecided_text(few, len(slices), f'a drop of {100 * version.gate.effect:g} points')}"
        parts.append(Text(head, style="bold red" if worse else "bold"))
        for item in sorted(slices, key=lambda item: not item.worse):
            text = f"  {'WORSE  ' if item.worse else ''}{item.name}: {slice_text(item, version.gate.effect)}"
            parts.append(Text(text, style="" if item.worse else "dim"))
        if version.unmatched:
            parts.append(Text(f"  {version.unmatched:,} rows have no counterpart and are not compared.", style="dim"))
        parts.append("")
    reasons = [f"{one.id} by {one.function} is {one.outcome}" for one in result.verdicts if not result.passes(one)]
    reasons += [
        f"{one.version} against {one.baseline} is undecided, since "
        f"{ALIKE_PLACES if one.gate.slices[0].alike else 'its places are too few'}"
        if one.undecided
        else f"{one.version} is worse than {one.baseline}"
        for one in result.versions
        if result.fails(one)
    ]
    parts.append(Text(f"The gate fails: {'; '.join(reasons)}." if reasons else "The gate passes.", style="bold"))
    return parts


def _verdicts(result: GateResult, suffix: str) -> bytes:
    from valerie.analysis.rows.table import encoded
    from valerie.analysis.verdicts.verdicts import verdict_table

    if suffix == ".json":
        return json.dumps(list(map(asdict, result.verdicts)), ensure_ascii=False, indent=1).encode()
    return encoded(verdict_table(result.verdicts), suffix[1:])


def run_reader(url: str | None, data_dir: Path | None) -> Callable[[str], GateRun]:
    """Return a function that reads a run from a server, or from the data folder."""
    if url is None:
        from valerie.local.deployment import context_of
        from valerie.pipeline.reading.gate_runs import read_gate_run

        def from_folder(run_id: str) -> GateRun:
            with context_of(data_dir) as context:
                return read_gate_run(context, run_id)

        return from_folder

    from valerie.cli.connecting import client_at

    def from_server(run_id: str) -> GateRun:
        import io

        from valerie.analysis.rows.table import EvaluationTable
        from valerie.analysis.verdicts.gate import GateRun
        from valerie.analysis.verdicts.verdicts import RequirementVerdict
        from valerie.runs.products.pins import ANY_PINS
        from valerie.runs.resolving.spec import RunSpec

        with client_at(url, data_dir) as client:
            verdicts = typed(tuple[RequirementVerdict, ...], client.summary(run_id).verdicts)
            detail = client.detail(run_id)
            table = EvaluationTable.from_parquet(io.BytesIO(client.evaluations(run_id)))
        spec, pins = RunSpec.model_validate(detail.spec), ANY_PINS.validate_python(detail.pins)
        return GateRun(run_id, spec, detail.asset_digest, pins, table, verdicts)

    return from_server
