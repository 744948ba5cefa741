"""How a training went: loss and held-out figures over its steps, in a file that outlives interruptions, and as a picture."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from valerie.errors import InvalidInput, MissingDependency
from valerie.perception.training.fit import TrainingProgress
from valerie.perception.training.validation import ValidationFigures

#: Points of the loss over a whole training: each is the mean of the steps since the one before.
_POINTS: Final = 200
#: Okabe and Ito: told apart by everyone.
_FIGURES: Final = {
    "person_pacc": ("person pACC", "#0072B2", "o"),
    "person_precision": ("person precision", "#E69F00", "D"),
    "person_iou": ("person IoU", "#CC79A7", "^"),
    "miou": ("mIoU", "#009E73", "s"),
}


class TrainingCurve:
    """Collects a training's progress; goes on where an interrupted one was.

    Args:
        file: ``….json``; written while the training goes on. The picture lies beside it.

    Raises:
        InvalidInput: the file holds something else.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._losses: list[float] = []
        self._begun = False
        self.loss: list[tuple[int, float]] = []
        self.figures: list[dict[str, Any]] = []
        if file.exists():
            try:
                stored = json.loads(file.read_bytes())
                self.loss = [(int(step), float(loss)) for step, loss in stored["loss"]]
                self.figures = [dict(one, step=int(one["step"])) for one in stored["figures"]]
            except (ValueError, KeyError, TypeError) as error:
                raise InvalidInput("not the curve of a training", field="curve", value=str(file)) from error

    def __call__(self, now: TrainingProgress) -> None:
        """A step was made."""
        if not self._begun:  # what came after the checkpoint that training goes on from is made again
            self._begun = True
            self.loss = [point for point in self.loss if point[0] < now.step]
            self.figures = [one for one in self.figures if one["step"] < now.step]
        self._losses.append(now.loss)
        if now.figures is not None:
            self.figures.append({"step": now.step, **asdict(now.figures)})
        if now.step % max(1, now.steps // _POINTS) == 0 or now.figures is not None:
            self.loss.append((now.step, sum(self._losses) / len(self._losses)))
            self._losses.clear()
            self._write()

    def finish(self, steps: int, figures: ValidationFigures | None, *, title: str) -> Path:
        """Add the figures of the finished network and draw.

        Returns:
            The picture (….png); where matplotlib is not installed, the file of numbers.
        """
        self.figures = [one for one in self.figures if one["step"] < steps]
        if figures is not None:
            self.figures.append({"step": steps, **asdict(figures)})
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
            points = [(one["step"], 100 * one[name]) for one in self.figures if one[name] is not None]
            if points:
                scores.plot(*zip(*points, strict=True), color=colour, marker=marker, markersize=5, label=label)
        scores.set_ylabel("held-out frames, pooled, per cent")
        scores.set_xlabel("step")
        scores.set_ylim(0, 100)
        if self.figures:
            counts = sorted({one["frames"] for one in self.figures})
            legend = f"{' to '.join(str(n) for n in {counts[0]: 0, counts[-1]: 0})} frames"
            scores.legend(title=legend, fontsize=9, title_fontsize=9, loc="lower right")
        for axes in (loss, scores):
            axes.grid(alpha=0.25)
            axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(path)
        return path

    def _write(self) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = self._file.with_name(self._file.name + ".part")
        unfinished.write_text(json.dumps({"loss": self.loss, "figures": self.figures}, indent=1) + "\n")
        unfinished.replace(self._file)
