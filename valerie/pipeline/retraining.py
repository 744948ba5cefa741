"""The loop back to training: from the rows where a function is weak to a new version of it.

Select rows of a run, read their region, draw scenes on streets that neither the run nor the function has seen until they
fall into it, and go on training from the function's weights. What comes out is a function file; comparing it is
`valerie.pipeline.comparison`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field

from valerie.analysis.frames import ABSENT
from valerie.analysis.region import Region, region_of
from valerie.db import runs
from valerie.db.engine import reading
from valerie.errors import InvalidInput
from valerie.perception.function_file import FunctionHeader, read_header
from valerie.perception.training.frames import FrameFolder, Shard
from valerie.perception.training.provenance import training_provenance
from valerie.perception.training.settings import TrainingSettings
from valerie.pipeline.context import Context
from valerie.pipeline.opening import function_file
from valerie.pipeline.resolution import resolve_stored
from valerie.pipeline.selection import evaluated_rows, function_index, run_where
from valerie.pipeline.training_frames import SEEDS, FrameSettings, render_frames
from valerie.pipeline.training_targets import quantities, run_values
from valerie.runs.spec import ResolvedRun

if TYPE_CHECKING:
    from valerie.perception.training.fit import TrainingProgress

#: Streets of functions that do not say which they have seen begin here.
_UNSEEN_SEED: Final = 50_000


class RetrainSettings(BaseModel):
    """How to build the training set and how long to train.

    Attributes:
        frames: to render, at least; rounded up to whole streets.
        streets: to spread them over.
        broad_share: of the frames, drawn anywhere, so that what the function could do is not forgotten.
        width, height: of the frames, pixels.
        held_out_frames: for the figures on the function's card; 0 leaves them out.
        steps, learning_rate, batch, seed: of the training; all else is as the function was trained before.
        first_seed: street seed to begin with; None: after those that the function has seen.
        targeted: False draws all frames anywhere: the control that a targeted set is measured against.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    frames: Annotated[int, Field(ge=1, le=100_000)] = 120
    streets: Annotated[int, Field(ge=1, le=1000)] = 8
    broad_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.5
    width: Annotated[int, Field(ge=32, le=8192)] = 960
    height: Annotated[int, Field(ge=32, le=8192)] = 540
    held_out_frames: Annotated[int, Field(ge=0, le=10_000)] = 20
    steps: Annotated[int, Field(ge=1)] = 300
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    batch: Annotated[int, Field(ge=2)] = 8
    seed: Annotated[int, Field(ge=0)] = 0
    first_seed: int | None = None
    targeted: bool = True

    def frame_settings(self, asset: str, arguments: dict[str, Any], region: Region, first_seed: int) -> FrameSettings:
        """What `render_frames` is to do."""
        return FrameSettings(
            streets=self.streets,
            per_street=-(-self.frames // self.streets),
            width=self.width,
            height=self.height,
            asset=asset,
            arguments=arguments,
            first_seed=first_seed,
            region=region if self.targeted else None,
            broad_share=self.broad_share if self.targeted else 0.0,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Weakness:
    """What a selection says about one function of a run.

    Attributes:
        run_id, function, where: what was asked.
        selected, evaluated: rows (persons in frames) that are selected, and all of that function with a person.
        region: read from the selected rows.
        asset, arguments: of the run's generated asset, without its seed.
        asset_seed: of the run; no training frame is from it.
        file, header: the function's weights.
    """

    run_id: str
    function: str
    where: str
    selected: int
    evaluated: int
    region: Region
    asset: str
    arguments: dict[str, Any]
    asset_seed: int
    file: Path
    header: FunctionHeader

    def first_seed(self) -> int:
        """The first street seed that neither the function's training nor the run has shown."""
        seen = [int(n) for n in re.findall(r"\d+", self.header.provenance.get("frames-street-seeds", ""))]
        first = max(seen, default=_UNSEEN_SEED - 1) + 1
        return max(first, self.asset_seed + 1) if self.asset_seed in SEEDS["train"] else first


@dataclass(frozen=True, slots=True, eq=False)
class Retrained:
    """What came out.

    Attributes:
        file: the function file.
        digest: SHA-256 of it.
        frames: training frames.
        drawn: scenes drawn to get them; as many as ``frames`` where every draw was taken.
        steps: training steps.
        street_seeds: of the training frames, first and last.
    """

    file: Path
    digest: str
    frames: int
    drawn: int
    steps: int
    street_seeds: tuple[int, int]


def find_weakness(context: Context, run_id: str, where: str, function: str | None = None) -> Weakness:
    """Read the region of the selected rows of one function of a run, and what is needed to train against it.

    Args:
        context: of the deployment.
        run_id: of a run on a generated asset that takes a seed.
        where: selects rows: ``pacc < 0.5 and distance_m > 25``.
        function: one of the run's; None where it has only one.

    Raises:
        NotFound: no such run.
        InvalidInput, UnknownName: the expression, the function or the asset do not allow it; or nothing is selected.
    """
    resolved = _resolved(context, run_id)
    name = _function(resolved, function)
    file = function_file(name)
    asset, arguments, seed = _generated(resolved)
    region, evaluated = _region(context, run_id, resolved, where, name)
    return Weakness(
        run_id=run_id,
        function=name,
        where=where,
        selected=region.rows,
        evaluated=evaluated,
        region=region,
        asset=asset,
        arguments=arguments,
        asset_seed=seed,
        file=file,
        header=read_header(file),
    )


def selected_region(context: Context, run_id: str, where: str, function: str) -> Region | None:
    """The region of a selection of one function's rows; None where the run did not evaluate that function.

    Raises:
        NotFound: no such run.
        InvalidInput, UnknownName: the expression is wrong, or selects nothing.
    """
    resolved = _resolved(context, run_id)
    return _region(context, run_id, resolved, where, function)[0] if function in resolved.spec.functions else None


def _resolved(context: Context, run_id: str) -> ResolvedRun:
    with reading(context.engine) as connection:
        return resolve_stored(runs.get(connection, run_id), context.settings)


def _region(context: Context, run_id: str, resolved: ResolvedRun, where: str, function: str) -> tuple[Region, int]:
    """The region, and how many persons that function was evaluated on."""
    condition = run_where(where, resolved)
    index = function_index(function, resolved)
    with reading(context.engine) as connection:
        rows = [
            row
            for _, row in evaluated_rows(connection, run_id, resolved, function=index)
            if row["undefined_reason"] != ABSENT
        ]
    selected = [row for row in rows if condition.holds(row)]
    if not selected:
        raise InvalidInput(f"selects none of {len(rows)} rows of {function}", field="where", value=where)
    everything = [run_values(row, resolved) for row in rows]
    return region_of((run_values(row, resolved) for row in selected), everything, quantities(resolved)), len(rows)


def retrain(
    weakness: Weakness,
    out: Path,
    settings: RetrainSettings,
    *,
    folder: Path,
    processes: int = 1,
    threads: int = 1,
    on_street: Callable[[Shard], None] = lambda _: None,
    on_step: Callable[[TrainingProgress], None] = lambda _: None,
) -> Retrained:
    """Render a training set for a weakness and train a new version of the function.

    Args:
        weakness: what to train against.
        out: function file to write.
        settings: how much.
        folder: where the frames go (``frames``, ``held-out`` and a checkpoint); what an earlier attempt with the same
            settings finished there is taken up.
        processes: that render.
        threads: torch's.
        on_street, on_step: progress.

    Raises:
        InvalidInput: hardly any scene lies in the region, or the folder holds something else.
        RenderingError, MissingDependency: as the raster engine and torch.
    """
    from valerie.perception.training.fit import train

    wanted = settings.frame_settings(
        weakness.asset,
        weakness.arguments,
        weakness.region,
        weakness.first_seed() if settings.first_seed is None else settings.first_seed,
    )
    _require_same(folder, {"frames": wanted.model_dump(mode="json"), "training": settings.model_dump(mode="json")})
    frames = _frames(folder / "frames", wanted, processes, on_street)
    held_out = _held_out(folder / "held-out", settings, wanted, processes)
    model = train(
        _training_settings(weakness.header, settings),
        frames,
        held_out=held_out if held_out is not None else (),
        progress=on_step,
        checkpoint=folder / "checkpoint.safetensors",
        start_from=weakness.file,
        threads=threads,
    )
    drawn = sum(shard.drawn or len(shard.sizes) for shard in frames.listing.shards)
    provenance = training_provenance(frames, held_out, weakness.file)
    provenance |= {
        "retrained-from-function": weakness.function,
        "retrained-from-run": weakness.run_id,
        "retrained-where": weakness.where,
        "retrained-region": weakness.region.model_dump_json() if settings.targeted else "none: drawn anywhere",
        "trained-by": "valerie train --from",
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(model.to_bytes(provenance))
    seeds = wanted.seeds()
    return Retrained(out, read_header(out).digest, len(frames), drawn, model.steps, (seeds[0], seeds[-1]))


def _frames(
    folder: Path, wanted: FrameSettings, processes: int, progress: Callable[[Shard], None] = lambda _: None
) -> FrameFolder:
    """The frames, rendered unless an earlier attempt finished them."""
    if (folder / "frames.json").is_file():
        return FrameFolder(folder)
    if folder.exists():  # an attempt that was interrupted: shards without their list
        for path in folder.iterdir():
            path.unlink()
    return render_frames(folder, wanted, processes=processes, progress=progress)


def _held_out(folder: Path, settings: RetrainSettings, wanted: FrameSettings, processes: int) -> FrameFolder | None:
    if not settings.held_out_frames:
        return None
    streets = min(len(SEEDS["held-out"]), max(1, settings.held_out_frames // 5))
    return _frames(
        folder,
        wanted.model_copy(
            update={
                "split": "held-out",
                "streets": streets,
                "per_street": -(-settings.held_out_frames // streets),
                "first_seed": None,
                "region": None,
                "broad_share": 0.0,
            }
        ),
        processes,
    )


def _training_settings(header: FunctionHeader, settings: RetrainSettings) -> TrainingSettings:
    """As the function was trained before, but shorter and gentler."""
    before = json.loads(header.provenance.get("training-settings", "{}"))
    known = {name: value for name, value in before.items() if name in TrainingSettings.model_fields}
    return TrainingSettings.model_validate(
        {
            **known,
            "architecture": header.architecture,
            "time_budget_s": None,
            "warmup_steps": min(20, settings.steps),
            **settings.model_dump(include={"steps", "learning_rate", "batch", "seed"}),
        }
    )


def _require_same(folder: Path, request: dict[str, Any]) -> None:
    path = folder / "request.json"
    if path.is_file():
        if json.loads(path.read_bytes()) != json.loads(json.dumps(request)):
            raise InvalidInput("the folder holds another training; name a new one", field="folder", value=str(folder))
        return
    if folder.exists() and any(folder.iterdir()):
        raise InvalidInput("the folder is not empty", field="folder", value=str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(request, indent=1) + "\n")


def _function(resolved: ResolvedRun, function: str | None) -> str:
    functions = resolved.spec.functions
    if function is None:
        if len(functions) != 1:
            raise InvalidInput("the run has several functions", field="--function", limit=", ".join(functions))
        return functions[0]
    function_index(function, resolved)
    return function


def _generated(resolved: ResolvedRun) -> tuple[str, dict[str, Any], int]:
    """Name, other arguments and seed of the run's asset.

    Raises:
        InvalidInput: it is not generated from a seed, so there are no fresh streets.
    """
    from valerie.scene.asset import GENERATORS

    asset = resolved.spec.asset
    reference = {"name": asset} if isinstance(asset, str) else dict(asset)
    name = str(reference.pop("name"))
    if name not in GENERATORS:
        raise InvalidInput(
            "new frames need fresh streets: an asset that is generated from a seed",
            field="asset",
            value=name,
            limit=", ".join(GENERATORS),
        )
    return name, reference, int(reference.pop("seed", 0))
