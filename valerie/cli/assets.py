"""Commands about scene assets."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from valerie.cli.shell import Exit, Json, command_name, console, say, settings_of
from valerie.errors import InvalidInput

if TYPE_CHECKING:
    from valerie.scene.assets.asset import SceneAsset
    from valerie.scene.variation.traverse import PathEntry

app = typer.Typer(no_args_is_help=True, help="Show, check, list, export, draft and convert scene assets.")

Asset = Annotated[
    str, typer.Argument(metavar="ASSET", help="Name of an asset (urban-street), or a folder with a manifest.")
]
Argument = Annotated[
    list[str] | None, typer.Option("--with", metavar="NAME=VALUE", help="Argument of a generator, e.g. --with seed=7.")
]


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the assets that a spec may name."""
    from valerie.scene.assets.asset import asset_manifest, asset_names

    folder = settings_of().asset_dir
    found: list[dict[str, Any]] = []
    for name in asset_names(folder):
        manifest, digest = asset_manifest(name, asset_dir=folder)
        found.append({"name": name, "title": manifest.title, "digest": digest})
    if as_json:
        typer.echo(json.dumps(found, ensure_ascii=False, indent=1))
        return
    for one in found:
        typer.echo(f"{one['name']}  {one['title']}")
    if found:
        say(f"see one with: {command_name()} asset show {found[0]['name']}")


@app.command()
def show(
    asset: Asset,
    declared: Annotated[bool, typer.Option("--declared", help="Only what specs may vary; reads no meshes.")] = False,
    arguments: Argument = None,
    as_json: Json = False,
) -> None:
    """List every path of an asset with type, unit, range and current value."""
    from valerie.scene.assets.asset import asset_manifest

    reference, folder = _reference(asset, arguments)
    manifest, digest = asset_manifest(reference, asset_dir=folder)
    if declared:
        from valerie.scene.variation.traverse import trajectory_parameters

        rows = [
            {**parameter.model_dump(mode="json"), "declared": True, "value": parameter.default}
            for parameter in (*manifest.parameters, *trajectory_parameters(manifest))
        ]
    else:
        from valerie.scene.variation.traverse import traverse

        rows = [_row(entry) for entry in traverse(_load(asset, arguments))]
    if as_json:
        typer.echo(json.dumps({"name": manifest.name, "digest": digest, "paths": rows}, ensure_ascii=False, indent=1))
        return
    from rich.padding import Padding
    from rich.text import Text

    out = console()
    out.print(Text.assemble((manifest.title, "bold"), f"  {manifest.name}, digest {digest}"))
    out.print(f"{manifest.description}\n" if manifest.description else "")
    out.print(f"cameras: {', '.join(manifest.cameras)}; persons: {', '.join(manifest.persons)}")
    out.print(f"movable: {', '.join(manifest.movable)}")
    for one in manifest.trajectories:
        ends = f"{one.keyframes[0]['time']:g}…{one.keyframes[-1]['time']:g} s"
        out.print(f"trajectory of {one.name}: {len(one.keyframes)} keyframes, {ends}, {', '.join(one.channels)}")
    out.print()
    out.print(_table(rows, declared=declared))
    for who, choices in _choices(rows).items():
        out.print(Padding(Text.assemble((who, "bold"), f": {' | '.join(choices)}"), (1, 0, 0, 0)))


@app.command()
def check(asset: Asset, arguments: Argument = None, as_json: Json = False) -> None:
    """Read a whole asset and say what it holds, and everything that is wrong with it or looks so.

    Exits with 2 when a run with the asset would be refused or fail.
    """
    from valerie.scene.assets.asset_folder import MANIFEST_FILE
    from valerie.scene.checks import Severity, asset_findings, scene_findings

    folder = Path(asset) if "/" in asset else settings_of().asset_dir / asset
    if (folder / MANIFEST_FILE).is_file():
        findings = asset_findings(folder)
        loaded = None
    else:
        loaded = _load(asset, arguments)
        findings = list(scene_findings(loaded))
    bad = any(finding.severity is Severity.ERROR for finding in findings)
    summary = {} if bad else _summary(loaded or _load(asset, arguments))
    if as_json:
        document = {"ok": not bad, **summary, "findings": [finding.document() for finding in findings]}
        typer.echo(json.dumps(document, ensure_ascii=False, indent=1))
    else:
        for finding in findings:
            say(str(finding))
        if summary:
            typer.echo(
                "{name}: {nodes:,} nodes, {triangles:,} visible triangles, {materials:,} materials, {cameras} cameras, "
                "{parameters} parameters; digest {digest}".format(**summary)
            )
    if bad:
        raise typer.Exit(Exit.INVALID_INPUT)


@app.command()
def draft(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with glTF files, and no manifest yet.")],
) -> None:
    """Write a first manifest for a folder of glTF files, to be corrected."""
    from valerie.scene.checks.manifest_draft import draft_manifest

    if not folder.is_dir():
        raise InvalidInput("no such folder", field="FOLDER", value=str(folder))
    say(f"wrote {draft_manifest(folder)}")
    say(f"correct it, then check it with: {command_name()} asset check {_as_folder(folder)}")


@app.command()
def convert(
    file: Annotated[Path, typer.Argument(metavar="FILE.blend", help="File of Blender.")],
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder of the asset, made if it is not there.")],
) -> None:
    """Convert a .blend file once into a glTF file with a first manifest; nothing that the file brings is run.

    Needs Blender's environment (`make cycles`).
    """
    from valerie.rendering.cycles.conversion import convert_blend
    from valerie.scene.assets.asset_folder import MANIFEST_FILE
    from valerie.scene.checks.manifest_draft import draft_manifest

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"the folder cannot be made ({error.strerror})", field="--out", value=str(out)) from error
    made = convert_blend(file, out / f"{file.stem}.glb", settings_of())
    for note in made.notes:
        say(f"note: {note}")
    say(f"wrote {made.path} with Blender {made.version}")
    if not (out / MANIFEST_FILE).exists():
        say(f"wrote {draft_manifest(out)}")
    say(f"check it with: {command_name()} asset check {_as_folder(out)}")


@app.command()
def export(
    asset: Asset,
    path: Annotated[Path, typer.Argument(metavar="FILE.glb", help="Binary glTF 2.0 file to write.")],
    arguments: Argument = None,
) -> None:
    """Write an asset as one binary glTF file."""
    from valerie.scene.gltf.writer import save_gltf

    if path.suffix.lower() != ".glb":
        raise InvalidInput("not a file name of binary glTF", field="FILE.glb", value=str(path), limit="….glb")
    try:
        save_gltf(_load(asset, arguments).base, path)
    except OSError as error:
        raise InvalidInput(f"the file cannot be written ({error.strerror})", value=str(path)) from error
    say(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")


def _as_folder(folder: Path) -> str:
    """As an argument that is taken for a folder, not for a name."""
    return str(folder) if "/" in str(folder) else f"./{folder}"


def _reference(asset: str, arguments: list[str] | None) -> tuple[str | dict[str, Any], Path | None]:
    """What `load_asset` takes: a folder given by its path is read where it is."""
    folder: Path | None = settings_of().asset_dir
    if "/" in asset and Path(asset).is_dir():
        return asset, None
    if not arguments:
        return asset, folder
    from valerie.loading import load_document

    given: dict[str, Any] = {"name": asset}
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if not equals or name == "name":
            raise InvalidInput("not an argument", field="--with", value=argument, limit="NAME=VALUE, e.g. seed=7")
        given.update(load_document(f"{name}: {value}"))
    return given, folder


def _load(asset: str, arguments: list[str] | None) -> SceneAsset:
    from valerie.scene.assets.asset import load_asset

    reference, folder = _reference(asset, arguments)
    return load_asset(reference, asset_dir=folder)


def _summary(asset: SceneAsset) -> dict[str, Any]:
    nodes = asset.base.nodes.values()
    return {
        "name": asset.name,
        "digest": asset.digest,
        "nodes": len(nodes),
        "triangles": sum(len(mesh.faces) for node in nodes if node.visible for mesh in node.meshes),
        "materials": len(asset.base.materials),
        "cameras": len(asset.base.cameras),
        "parameters": len(asset.manifest.parameters),
    }


def _row(entry: PathEntry) -> dict[str, Any]:
    return {**asdict(entry), "type": str(entry.type), "affects": str(entry.affects)}


def _table(rows: list[dict[str, Any]], *, declared: bool) -> Any:
    """One line per path; where all of them may vary, no column says so."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("path", overflow="fold")
    for column in ("type", "range", "unit"):
        table.add_column(column, no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    if not declared:
        table.add_column("varies", no_wrap=True)
    for row in rows:
        cells = [row["path"], row["type"], _range(row), row["unit"], _value(row["value"])]
        if not declared:
            cells.append("yes" if row["declared"] else "")
        table.add_row(*cells, style="" if row["declared"] else "dim")
    return table


def _choices(rows: list[dict[str, Any]]) -> dict[str, list[str]]:
    """What the values may be that are one of several: by attribute, or by path where two of the same attribute differ."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        if row["choices"]:
            found.setdefault(row["path"].rpartition(".")[2], {})[row["path"]] = row["choices"]
    named: dict[str, list[str]] = {}
    for attribute, paths in found.items():
        first = next(iter(paths.values()))
        named.update({attribute: first} if all(one == first for one in paths.values()) else paths)
    return named


def _range(row: dict[str, Any]) -> str:
    if row["choices"]:
        return f"{len(row['choices'])} choices"
    low, high = row["minimum"], row["maximum"]
    if low is None and high is None:
        return ""
    return f"{'−∞' if low is None else _value(low)} … {'∞' if high is None else _value(high)}"


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
