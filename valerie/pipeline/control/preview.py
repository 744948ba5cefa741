"""Pictures of a spec's variants before it is submitted, rendered by a child process that is bounded in time and memory."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock
from typing import Final, NamedTuple

from pydantic import ValidationError

from valerie import plugins
from valerie.db.engine import reading
from valerie.errors import InvalidInput, MissingDependency, RenderingError, TransientError, UnknownName
from valerie.parameters.definitions import Value
from valerie.parent import Wire, module_command, module_environment
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.pipeline.functions import registry
from valerie.pipeline.work.preview_process import PreviewAnswer, PreviewFrame, PreviewJob
from valerie.runs.forecasting.forecast import planned_variants
from valerie.runs.forecasting.plan import PlannedVariant
from valerie.runs.resolving.sensors import focal_length_mm, setting_of
from valerie.runs.resolving.spec import ResolvedRun, RunSpec

#: The engine that renders where the spec's cannot: it is installed with VALERIE and needs less than a second for a frame.
FALLBACK: Final = "raster"
#: Longer side of a picture, pixels.
SIDE: Final = 480
#: Distance from an index up to which an accepted variant is looked for.
_NEAR: Final = 500
#: Longest time for all pictures of a request by one engine. A street takes ten seconds to load on a busy machine, and half a
#: minute more until Cycles has it.
_SECONDS: Final = 90.0
#: Longest time that a request waits for another one.
PATIENCE_SECONDS: Final = 60.0
#: Settings that the child reads.
_ENGINE_SETTINGS: Final = frozenset(
    {"cycles_python", "cycles_device", "cycles_threads", "cycles_silence_seconds", "cycles_max_memory_mb"}
)
_COMMAND: Final = tuple(module_command("valerie.pipeline.work.preview_process"))


@dataclass(frozen=True, slots=True)
class Preview:
    """A variant before it is run.

    Attributes:
        variant: its values, and why it would be rejected.
        picture: PNG in base 64; None for a rejected variant.
    """

    variant: PlannedVariant
    picture: str | None


@dataclass(frozen=True, slots=True)
class Previewed:
    """Variants before they are run.

    Attributes:
        variants: in the order of the request.
        engine: the one that rendered.
        draft: its settings that differ from the spec's.
        problem: why it is not the spec's engine; None if it is.
    """

    variants: tuple[Preview, ...]
    engine: str
    draft: dict[str, Value]
    problem: str | None


class _Rendered(NamedTuple):
    answer: PreviewAnswer
    engine: str
    problem: str | None


class Previews:
    """Renders previews one after the other. The child process is started when it is needed, and again after its end."""

    def __init__(self, context: Context, *, command: Sequence[str] = _COMMAND, seconds: float = _SECONDS) -> None:
        """Prepare; no process is started.

        Args:
            context: of this process.
            command: of the child.
            seconds: longest time of one request for one engine.
        """
        self._context, self._command, self._seconds = context, command, seconds
        self._child: subprocess.Popen[bytes] | None = None
        # Linux reports the end of the thread that started a child as the parent's end; threads of requests end when idle.
        self._starter = ThreadPoolExecutor(1, "previews")
        self._lock = Lock()

    def render(
        self, spec: RunSpec, variants: Sequence[int], *, camera: str | None = None, accepted: bool = False
    ) -> Previewed:
        """Return pictures of variants by the first sensor of a spec, at the first moment of a sequence.

        The engine of the spec renders them, with its draft settings. Where it is missing, ends or takes too long, `FALLBACK`
        renders them.

        Args:
            spec: of a run; nothing is stored.
            variants: their indexes.
            camera: None takes the first of the spec.
            accepted: True takes the nearest accepted variant for a rejected one, where one is near.

        Raises:
            InvalidInput: the spec, an index or the camera, with field, value and limit.
            MissingDependency: this machine cannot render.
            TransientError: another request takes long, the child ended, or no engine was fast enough.
            RenderingError: the engine refuses the scene.
        """
        with reading(self._context.engine) as connection:
            names = registry.names(connection, registry.known(connection, spec.functions))
        resolved = resolve_new(spec, self._context.settings, registered=names)
        if camera is None:
            camera = resolved.cameras[0]
        elif camera not in resolved.cameras:
            raise UnknownName("camera of the spec", camera, resolved.cameras, field="camera")
        for index in variants:
            if not 0 <= index < resolved.space.size:
                raise InvalidInput(
                    "no such variant", field="variant", value=index, limit=f"0…{resolved.space.size - 1}"
                )
        if accepted:
            variants = list(dict.fromkeys(_nearest_accepted(resolved, index) for index in variants))
        planned = planned_variants(resolved, variants)
        legal = [variant.index for variant in planned if variant.rejection is None]
        rendered = self._rendered(_job(self._context, resolved, camera, legal))
        pictures = dict(zip(legal, rendered.answer.pictures, strict=True))
        return Previewed(
            variants=tuple(Preview(variant, pictures.get(variant.index)) for variant in planned),
            engine=rendered.engine,
            draft=_draft(rendered.engine),
            problem=rendered.problem,
        )

    def close(self) -> None:
        """End the child; no preview can be rendered afterwards."""
        with self._lock:
            self._end()
            self._starter.shutdown()

    def _rendered(self, job: PreviewJob) -> _Rendered:
        if not job.frames:
            return _Rendered(PreviewAnswer(), job.renderer, None)
        if not self._lock.acquire(timeout=PATIENCE_SECONDS):
            raise TransientError("another preview is being rendered; try again in a moment")
        try:
            answer, problem = self._first_answer(job)
            if problem is not None:
                job = job.model_copy(update={"renderer": FALLBACK, "settings": {}})
                answer = self._asked(job)
        finally:
            self._lock.release()
        if answer.engine_missing:
            raise MissingDependency(f"this server cannot render previews: {answer.error}")
        if answer.error is not None:
            raise RenderingError(f"preview: {answer.error}")
        return _Rendered(answer, job.renderer, problem)

    def _first_answer(self, job: PreviewJob) -> tuple[PreviewAnswer, str | None]:
        """Return the answer by the spec's engine, and why `FALLBACK` is to render instead; None if it is not."""
        try:
            answer = self._asked(job)
        except TransientError as error:
            if job.renderer == FALLBACK:
                raise
            return PreviewAnswer(), str(error)
        return answer, answer.error if answer.engine_missing and job.renderer != FALLBACK else None

    def _asked(self, job: PreviewJob) -> PreviewAnswer:
        """Return the child's answer; a child that had ended for want of work is started again."""
        message = job.model_dump_json().encode()
        if self._child is None or self._child.poll() is not None:
            self._end()
            self._child = self._starter.submit(self._started).result()
        assert self._child.stdin is not None
        wire = Wire(self._child.stdin, self._child.stdout, lambda: None, self._seconds)
        try:
            wire.send_message(message)
            return PreviewAnswer.model_validate_json(wire.receive_message())
        except TimeoutError:
            self._end()
            raise TransientError(f"the preview took longer than {self._seconds:g} s") from None
        except (EOFError, ValidationError):
            self._end()
            raise TransientError("the process that renders previews ended; try again") from None

    def _started(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=self._environment(),
        )

    def _environment(self) -> dict[str, str]:
        """Return the child's environment: without secrets, but with what engines need to know of the settings."""
        settings = self._context.settings.model_dump(mode="json", include=set(_ENGINE_SETTINGS))
        return {
            **module_environment("VALERIE_PLUGINS"),
            **{f"VALERIE_{name.upper()}": str(value) for name, value in settings.items()},
        }

    def _end(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            child.communicate()


def _draft(name: str) -> dict[str, Value]:
    engine = plugins.known_engine(name)
    return {} if engine is None else dict(engine.draft)


def _nearest_accepted(resolved: ResolvedRun, index: int) -> int:
    """Return the accepted variant next to an index, or the index itself where all around it are rejected."""
    neighbours = (index + sign * distance for distance in range(_NEAR) for sign in (1, -1))
    inside = (near for near in neighbours if 0 <= near < resolved.space.size)
    return next((near for near in inside if resolved.rejection(resolved.space[near].values) is None), index)


def _job(context: Context, resolved: ResolvedRun, camera: str, variants: Sequence[int]) -> PreviewJob:
    spec = resolved.spec
    frames = []
    for index in variants:
        values = dict(resolved.at(resolved.space[index].values, 0))
        sensor = setting_of(spec.sensors[0], values, moves=False)
        focal_length = focal_length_mm(resolved.manifest, camera, values)
        frames.append(PreviewFrame(values=values, sensor=sensor, focal_length_mm=focal_length))
    width, height = spec.resolution.width, spec.resolution.height
    scale = SIDE / max(width, height)
    return PreviewJob(
        renderer=spec.engine,
        settings={**spec.engine_settings, **_draft(spec.engine)},
        asset=spec.asset,
        asset_dir=context.settings.asset_dir,
        camera=camera,
        width=max(16, round(width * scale)),
        height=max(16, round(height * scale)),
        seed=spec.seed,
        frames=tuple(frames),
    )
