"""Commands about specs: write a first one, and show the cost of one."""

from __future__ import annotations

from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.registering import Opening, functions_named, open_registry, say_missing_files
from valerie.cli.shell import AsJson, DataDir, Url, print_json, say, write_output, write_template
from valerie.errors import InvalidInput
from valerie.local.deployment import deployment_or_empty, has_database, migrate_database, settings_of
from valerie.local.spec_files import read_spec
from valerie.local.terminal import console

if TYPE_CHECKING:
    from rich.table import Table

    from valerie.runs.forecasting.plan import Plan
    from valerie.runs.resolving.spec import ResolvedRun
    from valerie.settings import Settings

Functions = Annotated[
    str | None,
    typer.Option(
        "--functions",
        metavar="NAMES",
        help="Functions to use instead of the spec's: a,b. A file (my.onnx) is registered first.",
    ),
]


def new(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="File to write; - prints it.")] = Path("run.yaml"),
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write a commented spec to start from."""
    write_template("valerie.runs", path, force=force, then="plan")


def plan(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="YAML or JSON file; - reads standard input.")],
    functions: Functions = None,
    truth_only: Annotated[
        bool, typer.Option("--truth-only", help="Measure the persons of all variants, without rendering pictures.")
    ] = False,
    where: Annotated[
        str | None,
        typer.Option("--where", metavar="EXPRESSION", help='Choose variants by their truth: "occlusion_rate > 0.1".'),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the spec of the chosen variants.")
    ] = None,
    as_json: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Show what a spec would produce and cost, without storing anything.

    Asks the server that runs on the data folder, or computes the plan here if
    there is none. Only files in --functions are registered. --truth-only measures
    distance, area and occlusion here, for a small part of a rendering's cost.
    """
    settings = settings_of(data_dir)
    if not truth_only and (where is not None or output is not None):
        option = "--output" if where is None else "--where"
        raise InvalidInput("works only with --truth-only", field=option)
    text = spec_text(spec, functions, partial(open_registry, settings, url, create=True))
    if truth_only:
        _choose(text, settings, where=where, output=output, as_json=as_json)
        return
    plan = _plan(text, url, settings)
    if as_json:
        typer.echo(plan.model_dump_json(indent=1))
        return
    show_plan(plan)


#: Variants that are rendered to know the price of a picture.
_PRICED = 3


def _choose(text: bytes, settings: Settings, *, where: str | None, output: Path | None, as_json: bool) -> None:
    """Measure the truth of a spec's variants, choose among them, and compare its price with that of pictures."""
    from valerie import plugins
    from valerie.pipeline.work.truth_only import chosen_spec, measure_truths, price_of_layers
    from valerie.runs.resolving.where import choices_of, compile_where
    from valerie.scene.assets.asset import load_asset

    resolved = resolvable(text, settings)
    condition = None
    if where is not None:
        choices = choices_of(resolved.spec, resolved.cameras)
        condition = compile_where(where, resolved.definitions, choices=choices, field="--where")
        if condition.scored:
            raise InvalidInput("nothing is scored yet", field="--where", value=where, limit="measures of the truth")
    asset = load_asset(resolved.spec.asset, asset_dir=settings.asset_dir)
    with closing(plugins.create_truth_pass(resolved.spec.engine)) as truth_pass:
        variants = list(measure_truths(resolved, asset, truth_pass))
    selection = [v for v in variants if condition is None or any(map(condition.holds, v.rows))]
    for variant in selection if as_json else ():
        print_json({"variant": variant.assignment.index, "rows": variant.rows})
    say(f"{len(selection):,} of {len(variants):,} legal variants chosen")
    if len(variants) > 1:  # the first draws the statics
        cost = sum(variant.cpu_seconds for variant in variants[1:]) / (len(variants) - 1) / len(resolved.cameras)
        layer = price_of_layers(resolved, asset, variants[:_PRICED])
        engine = resolved.spec.engine
        say(f"CPU time of a frame: {1000 * cost:.1f} ms for its truth, {1000 * layer:.1f} ms for its layer by {engine}")
        say(f"a layer costs {layer / cost:.1f} times a truth, here and now")
    if output is not None:
        if not selection:
            raise InvalidInput("no variant is chosen", field="--where", value=where)
        write_output(output, chosen_spec(resolved, selection).to_yaml().encode())


def spec_text(path: Path, functions: str | None, opening: Opening) -> bytes:
    """Return the text of a spec, with its functions replaced if others are named.

    Args:
        path: file of the spec; ``-`` is standard input.
        functions: see `valerie.cli.registering.functions_named`.
        opening: opens the registry for files among the functions.

    Raises:
        InvalidInput: the file cannot be read, or is not a spec.
        ValerieError: a function's file cannot be registered.
    """
    text = read_spec(path)
    from valerie.runs.resolving.spec import parse

    if functions is None:
        say_missing_files(parse(text).functions)
        return text
    return parse({**parse(text).short(), "functions": functions_named(functions, opening)}).to_yaml().encode()


def resolvable(text: bytes, settings: Settings) -> ResolvedRun:
    """Return a spec resolved, before any process is started.

    Raises:
        InvalidInputs: every problem, with field, value and limit.
    """
    from valerie.db.engine import reading
    from valerie.pipeline.base.resolved_runs import resolve_new
    from valerie.pipeline.functions.registry import known, names
    from valerie.runs.resolving.spec import parse

    spec = parse(text)
    if has_database(settings):
        migrate_database(settings)  # as the system would do when it starts
    with deployment_or_empty(settings) as context, reading(context.engine) as connection:
        registered = names(connection, known(connection, spec.functions))
    return resolve_new(spec, settings, registered=registered)


def _plan(text: bytes, url: str | None, settings: Settings) -> Plan:
    from valerie.cli.connecting import client_of, own_assets
    from valerie.embedded import running

    if url is not None or running.find(settings.data_dir) is not None:
        with client_of(settings, url) as client, own_assets(settings, client):
            return client.plan(text)
    from valerie.pipeline.control.planning import plan_run
    from valerie.runs.resolving.spec import parse

    spec = parse(text)
    with deployment_or_empty(settings) as context:
        return plan_run(context, spec)


def show_plan(plan: Plan) -> None:
    """Print size and cost of a run."""
    from rich.table import Table
    from rich.text import Text

    out = console()
    about = "about " if plan.estimated else ""
    rejections = sum(plan.rejected.values())
    out.print(Text.assemble((plan.name, "bold"), f"  on {plan.asset}"))
    table = Table.grid(padding=(0, 2))
    table.add_column()
    table.add_column(justify="right")
    table.add_column()
    table.add_row("variants", f"{plan.variants:,}", f"{about}{rejections:,} rejected" if rejections else "")
    moments = f", {plan.moments:,} moments each" if plan.moments > 1 else ""
    cameras = "1 camera" if len(plan.cameras) == 1 else f"{len(plan.cameras)} cameras"
    table.add_row("frames", f"{about}{plan.frames:,}", f"{cameras}: {', '.join(plan.cameras)}{moments}")
    table.add_row("evaluations", f"{about}{plan.evaluations:,}", "frames × sensors × functions")
    out.print(table)
    for reason, count in sorted(plan.rejected.items(), key=lambda item: -item[1])[:8]:
        out.print(f"    rejected {about}{count:,}: {reason}", style="dim")
    out.print()
    _show_products(plan)
    out.print()
    out.print(_variants(plan))
    for warning in plan.warnings:
        out.print(f"warning: {warning}", style="yellow")
    for note in plan.notes:
        out.print(f"note: {note}", style="dim")
    if plan.estimated:
        out.print(f"note: rejections, frames and products are estimated from {plan.sample:,} variants", style="dim")


def _variants(plan: Plan) -> Table:
    """Return the first and the last variants, long ones wrapped."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    before = -1
    for variant in (*plan.first, *(v for v in plan.last if v not in plan.first)):
        if variant.index > before + 1:
            table.add_row("  …")
        before = variant.index
        values = variant.values.items()
        parts = [f"{name} {number_text(value)} {plan.units.get(name, '')}".rstrip() for name, value in values]
        if variant.sun is not None:
            parts.append(f"sun at {variant.sun[0]:.1f}°, {variant.sun[1]:.1f}° above the horizon")
        if variant.rejection:
            parts.append(f"rejected: {variant.rejection}")
        table.add_row(f"  variant {variant.index:,}", Text(", ".join(parts)))
    return table


def _show_products(plan: Plan) -> None:
    from rich.table import Table

    from valerie.runs.moments import duration

    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("product")
    table.add_column("made by")
    # Without workers it is unknown which products are present; a warning says so.
    known = any(product.present is not None for product in plan.products)
    blanks = ("", "") if known else ()
    for name in (*(("needed", "present") if known else ()), "to make", "CPU time", "disk"):
        table.add_column(name, justify="right", no_wrap=True)
    for product in plan.products:
        present = "unknown" if product.present is None else f"{product.present:,}"
        table.add_row(
            f"{product.kind} of backgrounds" if product.empty else str(product.kind),
            product.maker,
            *((f"{product.needed:,}", present) if known else ()),
            f"{product.to_make:,}",
            duration(product.cpu_seconds),
            _bytes(product.bytes),
        )
    if plan.start_cpu_seconds:
        table.add_row("start", "workers, asset, results", *blanks, "", duration(plan.start_cpu_seconds), "")
    table.add_section()
    to_make = sum(product.to_make for product in plan.products)
    table.add_row("total", "", *blanks, f"{to_make:,}", duration(plan.cpu_seconds), _bytes(plan.bytes))
    out = console()
    out.print(table)
    out.print(f"costs: {plan.cost_basis}", style="dim")


def _bytes(count: int) -> str:
    size = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit in ("B", "kB") else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:,.1f} TB"


def number_text(value: object) -> str:
    """Return a value, a number in its shortest form."""
    return f"{value:g}" if isinstance(value, float) else str(value)
