"""Retraining: from the region where a function is weak (`weakness`) to a new version of it.

Scenes are drawn on sites that neither the run nor the function has seen, until enough of them are in the region; training
continues from the function's weights. The result is a function file, which can be registered as the function's next version.
`valerie.pipeline.retraining.comparison` compares the two.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import JsonValue

from valerie.db.functions import FunctionRow
from valerie.errors import InvalidInput
from valerie.parameters.assignment import digest
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.importing.function_file import read_header
from valerie.perception.shipped import file_document
from valerie.perception.training.frame_folder import SEEDS, FrameFolder, Shard
from valerie.perception.training.provenance import training_provenance
from valerie.perception.training.start_weights import start_file
from valerie.perception.training.training_set import TrainingSet
from valerie.perception.training.training_settings import TrainingSettings
from valerie.pipeline.base.context import Context
from valerie.pipeline.functions.registry import register
from valerie.pipeline.retraining.training_frames import FrameSettings, render_training_frames
from valerie.pipeline.retraining.weakness import Weakness
from valerie.runs.study.retraining import RetrainSettings

if TYPE_CHECKING:
    from valerie.perception.training.fit import TrainingProgress


#: Evaluations of the held-out frames during a training, the last one at its end.
_VALIDATIONS: Final = 3


@dataclass(frozen=True, slots=True)
class TrainingResources:
    """The part of this machine that a training may use.

    Attributes:
        processes: number of processes that render.
        threads: CPU threads of torch.
    """

    processes: int = 1
    threads: int = 1


@dataclass(frozen=True, slots=True)
class Watcher:
    """Callbacks of a training.

    Attributes:
        on_site: called after every rendered site.
        on_step: called after every training step.
    """

    on_site: Callable[[Shard], None] = lambda _: None
    on_step: Callable[[TrainingProgress], None] = lambda _: None


@dataclass(frozen=True, slots=True, eq=False)
class Retrained:
    """The result of a training.

    Attributes:
        file: the function file.
        digest: SHA-256 of the file.
        before: document of the function at the start.
        frames: number of training frames.
        drawn: number of scenes that were drawn for them.
        steps: number of training steps.
        curve: picture of loss and held-out figures over the steps.
        site_seeds: first and last site seed of the training frames.
    """

    file: Path
    digest: str
    before: FunctionDocument
    frames: int
    drawn: int
    steps: int
    curve: Path
    site_seeds: tuple[int, int]


def retrain(
    weakness: Weakness,
    out: Path,
    settings: RetrainSettings,
    *,
    folder: Path,
    resources: TrainingResources = TrainingResources(),
    watcher: Watcher = Watcher(),
) -> Retrained:
    """Render a training set for a weakness and train a new version of the function.

    Args:
        weakness: the weakness to train against.
        out: function file to write.
        settings: settings of frames and training.
        folder: folder for frames (``frames``, ``held-out``) and a checkpoint; reuses the work of an earlier attempt with the
            same settings.
        resources: resources of this machine.
        watcher: callbacks for sites and steps.

    Raises:
        InvalidInput: too few drawn scenes are in the region, or the folder contains something else.
        RenderingError, MissingDependency: from the raster engine and torch.
    """
    from valerie.perception.training.curve import TrainingCurve
    from valerie.perception.training.fit import train

    frame_settings = _frame_settings(weakness, settings)
    _require_same(folder, _request(weakness, settings))
    start = folder / "start.safetensors"
    start.write_bytes(start_file(weakness.document, weakness.file))
    frames = _frames(folder / "frames", frame_settings, resources.processes, watcher.on_site)
    held_out = _held_out(folder / "held-out", settings, frame_settings, resources.processes)
    curve = TrainingCurve(folder / "curve.json")

    def note(progress: TrainingProgress) -> None:
        curve(progress)
        watcher.on_step(progress)

    model = train(
        _training_settings(weakness.document, settings),
        frames,
        held_out=held_out if held_out is not None else (),
        progress=note,
        checkpoint=folder / "checkpoint.safetensors",
        start_from=start,
        threads=resources.threads,
    )
    scenes = sum(shard.drawn or len(shard.sizes) for shard in frames.listing.shards)
    provenance = training_provenance(TrainingSet([frames]), held_out, start)
    provenance |= {
        "started-from": weakness.document.file.sha256,
        "retrained-from-function": weakness.function,
        "retrained-from-run": ", ".join(weakness.runs),
        "retrained-where": weakness.where,
        "retrained-region": weakness.region.model_dump_json() if settings.targeted else "none: drawn anywhere",
        "trained-by": "valerie train --from",
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(model.to_bytes(provenance))
    seeds = frame_settings.seeds()
    return Retrained(
        file=out,
        digest=read_header(out).digest,
        before=weakness.document,
        frames=len(frames),
        drawn=scenes,
        steps=model.steps,
        curve=curve.finish(model.steps, model.figures, title=f"{weakness.function} where {weakness.where}"),
        site_seeds=(seeds[0], seeds[-1]),
    )


def register_retrained(context: Context, retrained: Retrained, name: str) -> tuple[FunctionRow, bool]:
    """Register a new version: the original function with new weights.

    Returns:
        The registered version, and True if it is new.

    Raises:
        InvalidInputs: not a name of functions.
        Conflict: the name belongs to a function that is installed.
        StorageFull: no space left.
    """
    return register(context, _next_document(retrained, name), retrained.file)


def _next_document(retrained: Retrained, name: str) -> FunctionDocument:
    """Return the document of the new version.

    Engine, precision and input size stay; the normalisation is that of the file, in the channel order and unit of training.
    """
    original = file_document(name, retrained.file)
    normalised = {field: getattr(original.input, field) for field in ("mean", "std", "scale", "channel_order")}
    document = retrained.before.model_copy(
        update={
            "name": name,
            "payload": original.payload,
            "input": retrained.before.input.model_copy(update=normalised),
            "provenance": original.provenance,
        }
    )
    return parse_function(document.model_dump(mode="json"))


def training_folder(weakness: Weakness, settings: RetrainSettings, name: str) -> str:
    """Return the name of a training's folder: equal for equal trainings, so that repeating a command resumes it."""
    return f"{name}-{digest('training', _request(weakness, settings))[:8]}"


def _request(weakness: Weakness, settings: RetrainSettings) -> dict[str, JsonValue]:
    """Return the document that is equal for equal trainings."""
    return {
        "start": weakness.document.file.sha256,
        "frames": _frame_settings(weakness, settings).model_dump(mode="json"),
        "wanted": settings.model_dump(mode="json"),
        "training": _training_settings(weakness.document, settings).model_dump(
            mode="json", exclude={"loader_threads", "device"}
        ),
    }


def _frame_settings(weakness: Weakness, settings: RetrainSettings) -> FrameSettings:
    return FrameSettings(
        sites=settings.sites,
        per_site=-(-settings.frames // settings.sites),
        width=settings.width,
        height=settings.height,
        asset=weakness.asset,
        arguments=weakness.arguments,
        first_seed=weakness.first_seed() if settings.first_seed is None else settings.first_seed,
        region=weakness.region if settings.targeted else None,
        broad_share=settings.broad_share if settings.targeted else 0.0,
    )


def _frames(
    folder: Path, settings: FrameSettings, processes: int, progress: Callable[[Shard], None] = lambda _: None
) -> FrameFolder:
    """Return the frames, rendered unless an earlier attempt finished them."""
    if (folder / "frames.json").is_file():
        return FrameFolder(folder)
    if folder.exists():  # shards without their list, of an interrupted attempt
        for path in folder.iterdir():
            path.unlink()
    return render_training_frames(folder, settings, processes=processes, progress=progress)


def _held_out(folder: Path, settings: RetrainSettings, frames: FrameSettings, processes: int) -> FrameFolder | None:
    if not settings.held_out_frames:
        return None
    sites = min(len(SEEDS["held-out"]), max(1, settings.held_out_frames // 5))
    return _frames(
        folder,
        frames.model_copy(
            update={
                "split": "held-out",
                "sites": sites,
                "per_site": -(-settings.held_out_frames // sites),
                "first_seed": None,
                "region": None,
                "broad_share": 0.0,
            }
        ),
        processes,
    )


def _training_settings(document: FunctionDocument, settings: RetrainSettings) -> TrainingSettings:
    """Return the settings of the previous training, with fewer steps and a lower learning rate."""
    before = json.loads(document.provenance.get("training-settings", "{}"))
    # The precision and the device are those of this machine.
    known = {
        name: value
        for name, value in before.items()
        if name in TrainingSettings.model_fields and name not in ("precision", "device")
    }
    return TrainingSettings.model_validate(
        {
            **known,
            "architecture": document.architecture,
            "longest_side": document.input.longest_side,
            "time_budget_s": None,
            "keep_norm_statistics": True,
            "validate_every": max(1, settings.steps // _VALIDATIONS),
            "warmup_steps": min(20, settings.steps),
            **settings.model_dump(include={"steps", "learning_rate", "batch", "seed"}),
        }
    )


def _require_same(folder: Path, request: dict[str, JsonValue]) -> None:
    path = folder / "request.json"
    if path.is_file():
        if json.loads(path.read_bytes()) != json.loads(json.dumps(request)):
            raise InvalidInput(
                "the folder holds another training; name another folder", field="folder", value=str(folder)
            )
        return
    if folder.exists() and any(folder.iterdir()):
        raise InvalidInput("the folder is not empty", field="folder", value=str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(request, indent=1) + "\n")
