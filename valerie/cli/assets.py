"""Commands about scene assets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, cast

import typer

from valerie.cli.shell import AsJson, Exit, print_json, say
from valerie.cli.specs import number_text
from valerie.errors import InvalidInput
from valerie.local.deployment import settings_of
from valerie.local.terminal import command_name, console

if TYPE_CHECKING:
    from rich.table import Table

    from valerie.scene.assets.asset import AssetArguments, AssetReference, SceneAsset
    from valerie.scene.variation.traverse import PathEntry

app = typer.Typer(no_args_is_help=True, help="Show, check, list, export, draft and convert scene assets.")

Asset = Annotated[
    str, typer.Argument(metavar="ASSET", help="Name of an asset (urban-street), or path of a folder with a manifest.")
]
Argument = Annotated[
    list[str] | None, typer.Option("--with", metavar="NAME=VALUE", help="Argument of a generator, e.g. --with seed=7.")
]


@app.command("list")
def list_(as_json: AsJson = False) -> None:
    """List the assets that a spec can name."""
    from valerie.scene.assets.asset import asset_manifest, asset_names

    folder = settings_of().asset_dir
    assets: list[dict[str, str]] = []
    for name in asset_names(folder):
        manifest, digest = asset_manifest(name, asset_dir=folder)
        assets.append({"name": name, "title": manifest.title, "digest": digest})
    if as_json:
        print_json(assets, indent=1)
        return
    for asset in assets:
        typer.echo(f"{asset['name']}  {asset['title']}")
    if assets:
        say(f"show one with: {command_name()} asset show {assets[0]['name']}")


@app.command()
def show(
    asset: Asset,
    declared: Annotated[
        bool, typer.Option("--declared", help="List only the parameters that specs may vary; reads no meshes.")
    ] = False,
    arguments: Argument = None,
    as_json: AsJson = False,
) -> None:
    """List every path of an asset with type, unit, range and current value."""
    from valerie.scene.assets.asset import asset_manifest

    reference, folder = _reference(asset, arguments)
    manifest, digest = asset_manifest(reference, asset_dir=folder)
    if declared:
        from valerie.scene.variation.traverse import declared_entry, trajectory_parameters

        parameters = (*manifest.parameters, *trajectory_parameters(manifest))
        entries = [declared_entry(parameter) for parameter in parameters]
        paths = [
            {**parameter.model_dump(mode="json"), "declared": True, "value": parameter.default}
            for parameter in parameters
        ]
    else:
        from valerie.scene.variation.traverse import traverse

        entries = list(traverse(_load(asset, arguments)))
        paths = [{**asdict(entry), "type": str(entry.type), "affects": str(entry.affects)} for entry in entries]
    if as_json:
        print_json({"name": manifest.name, "digest": digest, "paths": paths}, indent=1)
        return
    from rich.padding import Padding
    from rich.text import Text

    out = console()
    out.print(Text.assemble((manifest.title, "bold"), f"  {manifest.name}, digest {digest}"))
    out.print(f"{manifest.description}\n" if manifest.description else "")
    out.print(f"cameras: {', '.join(manifest.cameras)}; persons: {', '.join(manifest.persons)}")
    out.print(f"movable: {', '.join(manifest.movable)}")
    for trajectory in manifest.trajectories:
        keyframes, channels = trajectory.keyframes, ", ".join(trajectory.channels)
        ends = f"{keyframes[0]['time']:g}…{keyframes[-1]['time']:g} s"
        out.print(f"trajectory of {trajectory.name}: {len(keyframes)} keyframes, {ends}, {channels}")
    out.print()
    out.print(_table(entries, declared=declared))
    for name, choices in _choices(entries).items():
        out.print(Padding(Text.assemble((name, "bold"), f": {' | '.join(choices)}"), (1, 0, 0, 0)))


@app.command()
def check(asset: Asset, arguments: Argument = None, as_json: AsJson = False) -> None:
    """Read a whole asset, and report its contents, errors and warnings.

    Exits with 2 if a run with the asset would be refused or fail.
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
    ok = all(finding.severity is not Severity.ERROR for finding in findings)
    summary = _Contents.of(loaded or _load(asset, arguments)) if ok else None
    if as_json:
        document = {
            "ok": ok,
            **(summary._asdict() if summary else {}),
            "findings": [finding.document() for finding in findings],
        }
        print_json(document, indent=1)
    else:
        for finding in findings:
            say(str(finding))
        if summary:
            typer.echo(
                "{name}: {nodes:,} nodes, {triangles:,} visible triangles, {materials:,} materials, {cameras} cameras, "
                "{parameters} parameters; digest {digest}".format(**summary._asdict())
            )
    if not ok:
        raise typer.Exit(Exit.INVALID_INPUT)


@app.command()
def draft(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with glTF files and without a manifest.")],
) -> None:
    """Write a first manifest for a folder of glTF files, for you to correct."""
    from valerie.scene.checks.manifest_draft import draft_manifest

    if not folder.is_dir():
        raise InvalidInput("no such folder", field="FOLDER", value=str(folder))
    say(f"wrote {draft_manifest(folder)}")
    say(f"correct it, then check it with: {command_name()} asset check {_as_folder(folder)}")


@app.command()
def convert(
    file: Annotated[Path, typer.Argument(metavar="FILE.blend", help="Blender file.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Folder of the asset; created if it does not exist.")
    ],
) -> None:
    """Convert a .blend file to a glTF file with a first manifest. Scripts in the file are not run.

    Requires Blender's environment (`make cycles`).
    """
    from valerie.rendering.cycles.conversion import convert_blend
    from valerie.scene.assets.asset_folder import MANIFEST_FILE
    from valerie.scene.checks.manifest_draft import draft_manifest

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"the folder cannot be created ({error.strerror})", field="--out", value=str(out)) from error
    conversion = convert_blend(file, out / f"{file.stem}.glb", settings_of())
    for note in conversion.notes:
        say(f"note: {note}")
    say(f"wrote {conversion.path} with Blender {conversion.version}")
    if not (out / MANIFEST_FILE).exists():
        say(f"wrote {draft_manifest(out)}")
    say(f"check it with: {command_name()} asset check {_as_folder(out)}")


@app.command()
def export(
    asset: Asset,
    path: Annotated[Path, typer.Argument(metavar="FILE.glb", help="Binary glTF 2.0 file to write.")],
    arguments: Argument = None,
) -> None:
    """Write an asset as a binary glTF file."""
    from valerie.scene.gltf.writer import save_gltf

    if path.suffix.lower() != ".glb":
        raise InvalidInput("not the name of a binary glTF file", field="FILE.glb", value=str(path), limit="….glb")
    try:
        save_gltf(_load(asset, arguments).base, path)
    except OSError as error:
        raise InvalidInput(f"the file cannot be written ({error.strerror})", value=str(path)) from error
    say(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")


def _as_folder(folder: Path) -> str:
    """Return an argument that commands read as a folder, not as the name of an asset."""
    return str(folder) if "/" in str(folder) else f"./{folder}"


def _reference(asset: str, arguments: list[str] | None) -> tuple[AssetReference, Path | None]:
    """Return the arguments of `load_asset`; a folder given by its path is read in place."""
    folder: Path | None = settings_of().asset_dir
    if "/" in asset and Path(asset).is_dir():
        return asset, None
    if not arguments:
        return asset, folder
    from valerie.loading import load_document

    reference: AssetArguments = {"name": asset}
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if not equals or name == "name":
            raise InvalidInput("not an argument", field="--with", value=argument, limit="NAME=VALUE, e.g. seed=7")
        reference.update(cast("AssetArguments", load_document(f"{name}: {value}")))  # `load_asset` checks the values
    return reference, folder


def _load(asset: str, arguments: list[str] | None) -> SceneAsset:
    from valerie.scene.assets.asset import load_asset

    reference, folder = _reference(asset, arguments)
    return load_asset(reference, asset_dir=folder)


class _Contents(NamedTuple):
    """Names and numbers of an asset."""

    name: str
    digest: str
    nodes: int
    triangles: int
    materials: int
    cameras: int
    parameters: int

    @classmethod
    def of(cls, asset: SceneAsset) -> _Contents:
        nodes = asset.base.nodes.values()
        return cls(
            name=asset.name,
            digest=asset.digest,
            nodes=len(nodes),
            triangles=sum(len(mesh.faces) for node in nodes if node.visible for mesh in node.meshes),
            materials=len(asset.base.materials),
            cameras=len(asset.base.cameras),
            parameters=len(asset.manifest.parameters),
        )


def _table(entries: Sequence[PathEntry], *, declared: bool) -> Table:
    """Return a table with one line per path; ``declared``: all may vary, so the column about it is left out."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("path", overflow="fold")
    for column in ("type", "range", "unit"):
        table.add_column(column, no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    if not declared:
        table.add_column("varies", no_wrap=True)
    for entry in entries:
        cells = [entry.path, str(entry.type), _range(entry), entry.unit, number_text(entry.value)]
        if not declared:
            cells.append("yes" if entry.declared else "")
        table.add_row(*cells, style="" if entry.declared else "dim")
    return table


def _choices(entries: Sequence[PathEntry]) -> dict[str, tuple[str, ...]]:
    """Return choices by attribute, or by path if two paths with the same attribute have different choices."""
    by_attribute: dict[str, dict[str, tuple[str, ...]]] = {}
    for entry in entries:
        if entry.choices:
            by_attribute.setdefault(entry.path.rpartition(".")[2], {})[entry.path] = entry.choices
    by_name: dict[str, tuple[str, ...]] = {}
    for attribute, by_path in by_attribute.items():
        first = next(iter(by_path.values()))
        by_name.update({attribute: first} if all(choices == first for choices in by_path.values()) else by_path)
    return by_name


def _range(entry: PathEntry) -> str:
    if entry.choices:
        return f"{len(entry.choices)} choices"
    low, high = entry.minimum, entry.maximum
    if low is None and high is None:
        return ""
    return f"{'−∞' if low is None else number_text(low)} … {'∞' if high is None else number_text(high)}"
