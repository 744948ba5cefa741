"""The training curve: loss and held-out figures over the steps, in a file that survives interruptions, and as a picture."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput, MissingDependency
from valerie.perception.training.fit import TrainingProgress
from valerie.perception.training.held_out_figures import ValidationFigures

#: Points of the loss over a whole training: each is the mean of the steps since the previous one.
_POINTS: Final = 200
#: Colours of Okabe and Ito, which colour-blind readers can distinguish.
_FIGURES: Final = {
    "person_pacc": ("person pACC", "#0072B2", "o"),
    "person_precision": ("person precision", "#E69F00", "D"),
    "person_iou": ("person IoU", "#CC79A7", "^"),
    "miou": ("mIoU", "#009E73", "s"),
}


@dataclass(frozen=True, slots=True)
class Validated:
    """Held-out figures after a number of steps."""

    step: int
    figures: ValidationFigures


class TrainingCurve:
    """The progress of a training, which may continue an interrupted one.

    Args:
        file: ``….json``, written during the training; the picture is written beside it.

    Attributes:
        loss: step and mean loss of each point.
        validations: in the order of their steps.

    Raises:
        InvalidInput: the file is not such a curve.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._losses: list[float] = []
        self._begun = False
        self.loss: list[tuple[int, float]] = []
        self.validations: list[Validated] = []
        if file.exists():
            try:
                document = json.loads(file.read_bytes())
                self.loss = [(int(step), float(loss)) for step, loss in document["loss"]]
                self.validations = [
                    Validated(int(entry.pop("step")), ValidationFigures(**entry)) for entry in document["figures"]
                ]
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise InvalidInput("not the curve of a training", field="curve", value=str(file)) from error

    def __call__(self, now: TrainingProgress) -> None:
        """Add a step."""
        if not self._begun:  # steps after the checkpoint that training resumes from are repeated
            self._begun = True
            self.loss = [point for point in self.loss if point[0] < now.step]
            self._forget_from(now.step)
        self._losses.append(now.loss)
        if now.figures is not None:
            self.validations.append(Validated(now.step, now.figures))
        if now.step % max(1, now.steps // _POINTS) == 0 or now.figures is not None:
            self.loss.append((now.step, sum(self._losses) / len(self._losses)))
            self._losses.clear()
            self._write()

    def finish(self, steps: int, figures: ValidationFigures | None, *, title: str) -> Path:
        """Add the figures of the finished network and draw.

        Returns:
            The picture (….png); the file of numbers if matplotlib is not installed.
        """
        self._forget_from(steps)
        if figures is not None:
            self.validations.append(Validated(steps, figures))
        self._write()
        try:
            return self.draw(self._file.with_suffix(".png"), title=title)
        except MissingDependency:
            return self._file

    def draw(self, path: Path, *, title: str) -> Path:
        """Write the picture.

        Raises:
            MissingDependency: matplotlib is not installed.
        """
        try:
            from matplotlib.figure import Figure
        except ModuleNotFoundError as error:
            raise MissingDependency("pictures need matplotlib: install valerie[report]") from error
        figure = Figure(figsize=(8.0, 6.4), dpi=110, layout="constrained")
        loss, scores = figure.subplots(2, 1, sharex=True, height_ratios=(2, 3))
        figure.suptitle(title, fontsize=11)
        loss.plot(*zip(*self.loss, strict=True) if self.loss else ((), ()), color="#555555", linewidth=1.2)
        loss.set_ylabel("training loss")
        loss.set_ylim(bottom=0)
        for name, (label, colour, marker) in _FIGURES.items():
            scores_of = [(validated.step, getattr(validated.figures, name)) for validated in self.validations]
            points = [(step, 100 * score) for step, score in scores_of if score is not None]
            if points:
                scores.plot(*zip(*points, strict=True), color=colour, marker=marker, markersize=5, label=label)
        scores.set_ylabel("held-out frames, pooled, per cent")
        scores.set_xlabel("step")
        scores.set_ylim(0, 100)
        if self.validations:
            counts = sorted({validated.figures.frames for validated in self.validations})
            legend = f"{' to '.join(str(n) for n in {counts[0]: 0, counts[-1]: 0})} frames"
            scores.legend(title=legend, fontsize=9, title_fontsize=9, loc="lower right")
        for axes in (loss, scores):
            axes.grid(alpha=0.25)
            axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(path)
        return path

    def _forget_from(self, step: int) -> None:
        self.validations = [validated for validated in self.validations if validated.step < step]

    def _write(self) -> None:
        figures = [{"step": validated.step, **asdict(validated.figures)} for validated in self.validations]
        self._file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = self._file.with_name(self._file.name + ".part")
        unfinished.write_text(json.dumps({"loss": self.loss, "figures": figures}, indent=1) + "\n")
        unfinished.replace(self._file)
