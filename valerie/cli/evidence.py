"""Commands that export the evidence of a run as one folder, and check such a folder."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.shell import AsJson, DataDir, Exit, RunId, decide, print_json
from valerie.local.deployment import context_of, settings_of

if TYPE_CHECKING:
    from valerie.pipeline.evidence.replaying import ReplayedPicture

app = typer.Typer(no_args_is_help=True, help="Export the evidence of a run as one folder, and check it.")
_keys = typer.Typer(no_args_is_help=True, help="Keys that sign evidence.")
app.add_typer(_keys, name="key")


@app.command()
def export(
    run_id: RunId,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FOLDER", help="Folder to create.", show_default="evidence/ next to the data folder"
        ),
    ] = None,
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Private key to sign with; see `valerie evidence key new`."),
    ] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Write spec, results, environment, and the frames that findings and verdicts name, as one folder (RO-Crate 1.2).

    Exporting a run again gives equal bytes.
    """
    from valerie.pipeline.evidence.exporting import export_evidence

    with context_of(data_dir) as context:
        folder = out or settings_of(data_dir).data_dir.parent / "evidence" / run_id
        evidence = export_evidence(context, run_id, folder, key=key)
    if as_json:
        print_json(asdict(evidence) | {"folder": str(evidence.folder)})
        return
    signature = f"signed by key {evidence.signer}" if evidence.signer else "not signed"
    typer.echo(f"{evidence.folder}: {evidence.files:,} files, {evidence.frames:,} frames; {signature}")
    typer.echo(f"root {evidence.root}")


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder that `valerie evidence export` wrote.")],
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Public key of the signer; without it, any signer passes."),
    ] = None,
    replay: Annotated[
        int, typer.Option("--replay", metavar="N", min=0, help="Also render N frames again, chosen at random.")
    ] = 0,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Check an evidence folder offline; nothing in it is executed.

    Exits with 3 if a file is missing, changed, not listed, a link or too large,
    if the key did not sign the folder, or if a replayed frame differs; with 5 if
    a frame cannot be replayed on this machine.
    """
    from valerie.cli.progress_lines import counting
    from valerie.pipeline.evidence.evidence_manifest import Refused
    from valerie.pipeline.evidence.verifying import UNSIGNED
    from valerie.pipeline.evidence.verifying import verify as verify_folder

    pictures: list[ReplayedPicture] = []
    try:
        verified = verify_folder(folder, key=key, progress=counting("files checked"))
        if replay:
            from valerie.pipeline.evidence.replaying import replay as replay_frames

            pictures = replay_frames(folder, replay, settings_of(data_dir))
    except Refused as error:
        code = decide(Exit.COMPLETED_WITH_FAILURES)
        if as_json:
            print_json({"problems": error.problems})
        else:
            typer.echo(f"{folder}: refused")
            for problem in error.problems:
                typer.echo(f"  {problem}")
        raise typer.Exit(code) from None
    verdicts = {picture.verdict for picture in pictures}
    code = (
        Exit.COMPLETED_WITH_FAILURES if "differs" in verdicts else Exit.ENVIRONMENT if verdicts - {"equal"} else Exit.OK
    )
    decide(code)
    if as_json:
        print_json(asdict(verified) | {"problems": [], "replayed": list(map(asdict, pictures))})
    else:
        unknown = ", signer unknown" if verified.signed else f". {UNSIGNED}."
        signer = f", signed by key {verified.signer}" if verified.signer else unknown
        typer.echo(f"{folder}: {verified.files:,} files are consistent{signer}")
        typer.echo(f"root {verified.root}")
        for picture in pictures:
            typer.echo(f"{picture.file or 'frames'}: {picture.verdict}")
        if replay and not pictures:
            typer.echo("no frame to replay: findings and verdicts name none")
    raise typer.Exit(code)


@_keys.command()
def new(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="File for the private key; the public one goes into FILE.pub.")
    ],
) -> None:
    """Make an Ed25519 key pair: FILE, readable only by you, and FILE.pub for those who verify."""
    from valerie.pipeline.evidence.signing import new_key

    key_id = new_key(file)
    typer.echo(f"{file}: key {key_id}; give {file}.pub to those who verify")
