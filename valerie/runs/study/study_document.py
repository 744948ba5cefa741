"""The study as a document: the varied parameters as in a run spec, and the question, the budget and the stop rule.

A file has the fields of a spec and those of a study side by side. `parse_study` separates them: ``vary`` becomes the
operational domain; the rest of the spec applies to every run of the study.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Final, Literal, Self

import yaml
from pydantic import Discriminator, Field, JsonValue, Tag, ValidationError, model_validator

from valerie import plugins
from valerie.document import Document
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.loading import load_document
from valerie.parameters.assignment import digest
from valerie.plain import Json, JsonObject
from valerie.plugins import GOALS
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.moments import Moment
from valerie.runs.resolving.spec import parse
from valerie.runs.study.measure import parse_measure
from valerie.runs.study.retraining import Rounds
from valerie.runs.values import Name, Scalar, Share, Text
from valerie.validation import problem_of

#: Fields of a spec that a study sets itself.
_DECIDED: Final = ("blocks", "design", "count", "points", "requirements", "parent_run", "iteration")


class StudyState(StrEnum):
    """State of a study."""

    #: Proposes and runs batches.
    RUNNING = "running"
    #: Waits for a person; its reason says what for.
    PAUSED = "paused"
    #: The goal is reached, or the budget is spent.
    FINISHED = "finished"
    #: A person ended it.
    STOPPED = "stopped"

    @property
    def is_final(self) -> bool:
        """True if the study does nothing more."""
        return self in (StudyState.FINISHED, StudyState.STOPPED)


class GoalDocument(Document):
    """The fields that every goal states.

    Attributes:
        question: its question in words.
        functions: number of functions under test that it needs.
        bounded: True if it needs scores on both sides of the measure's bound.
    """

    question: ClassVar[str]
    functions: ClassVar[int] = 1
    bounded: ClassVar[bool] = True


class EstimateGoal(GoalDocument):
    """Estimate the failure rate, by `valerie.guided.estimate`.

    Attributes:
        first: number of operational points at the beginning; by default a quarter of the budget, 24 to 256.
    """

    question = "How often does a variant fail?"
    name: Literal["estimate"] = "estimate"
    first: Annotated[int, Field(strict=True, ge=20, le=100_000)] | None = None


class FindGoal(GoalDocument):
    """Find the modes of failure, by `valerie.guided.find`.

    Attributes:
        repeats: further seeds under which a failure must fail; 0 if nothing is random.
    """

    question = "In how many ways does a variant fail?"
    name: Literal["find"] = "find"
    repeats: Annotated[int, Field(strict=True, ge=0, le=10)] = 1


class MapGoal(GoalDocument):
    """Map the boundary between pass and fail, by `valerie.guided.map`."""

    question = "Where is the boundary between pass and fail?"
    name: Literal["map"] = "map"


class ExplainGoal(GoalDocument):
    """Find the smallest change that flips the verdict, by `valerie.guided.explain`.

    Attributes:
        failing, passing: values of the varied parameters of two variants. Without them, the first batch is drawn from the
            operational density, and the study starts from its lowest score and the nearest variant that passes.
    """

    question = "Which smallest change flips the verdict?"
    bounded = False
    name: Literal["explain"] = "explain"
    failing: dict[str, Scalar] | None = None
    passing: dict[str, Scalar] | None = None

    @model_validator(mode="after")
    def _both(self) -> Self:
        if (self.failing is None) != (self.passing is None):
            missing = "failing" if self.failing is None else "passing"
            raise InvalidInput(
                "a pair has a failing and a passing variant", field=f"goal.{missing}", limit="both, or neither"
            )
        return self


class VerifyGoal(GoalDocument):
    """Verify a requirement, by `valerie.guided.verify`.

    Attributes:
        share: smallest share of variants that pass. Without it, the mean score of the variants must reach the bound of the
            measure.
        confidence: 1 − the chance of a false verdict.
    """

    question = "Is the requirement met?"
    name: Literal["verify"] = "verify"
    share: Annotated[Share, Field(gt=0, lt=1)] | None = None
    confidence: Annotated[Share, Field(ge=0.5, lt=1)] = 0.95


class CompareGoal(GoalDocument):
    """Compare two functions, by `valerie.guided.compare`.

    Attributes:
        within: half width of the interval that suffices.
        of: compared quantity: the ``mean`` score, or the ``share`` of variants that pass.
        level: confidence of the interval, and of the verdict.
    """

    question = "Which of the two functions is better?"
    functions = 2
    name: Literal["compare"] = "compare"
    within: Annotated[Share, Field(gt=0, lt=1)]
    of: Literal["mean", "share"] = "mean"
    level: Annotated[Share, Field(ge=0.5, lt=1)] = 0.95


class CascadeGoal(GoalDocument):
    """Estimate what a costly render engine says from few of its frames, by `valerie.guided.cascade`.

    Attributes:
        renderer: the costly engine, as in a spec; that of the spec is the cheap one.
        of: what is estimated: the ``mean`` score, or the failure ``rate``.
    """

    question = "What does the costly render engine say?"
    name: Literal["cascade"] = "cascade"
    renderer: Name | dict[str, Scalar]
    of: Literal["mean", "rate"] = "mean"


class RankGoal(GoalDocument):
    """Rank the parameters by their effect, by `valerie.guided.rank`."""

    question = "Which parameters matter?"
    bounded = False
    name: Literal["rank"] = "rank"


class PluginGoal(GoalDocument):
    """Pursue a strategy of another package (`valerie.plugins`).

    Attributes:
        name: name of its entry point.
        options: its own options.
    """

    question = "What does the strategy of another package find?"
    name: Name
    options: dict[str, Scalar] = Field(default_factory=dict)


_PLUGIN: Final = "plug-in"


def _kind(goal: Any) -> str:
    """Return the tag of a goal or of its document."""
    name = goal.get("name") if isinstance(goal, Mapping) else getattr(goal, "name", None)
    return name if name in GOALS else _PLUGIN


Goal = Annotated[
    Annotated[EstimateGoal, Tag("estimate")]
    | Annotated[FindGoal, Tag("find")]
    | Annotated[MapGoal, Tag("map")]
    | Annotated[ExplainGoal, Tag("explain")]
    | Annotated[VerifyGoal, Tag("verify")]
    | Annotated[CompareGoal, Tag("compare")]
    | Annotated[RankGoal, Tag("rank")]
    | Annotated[CascadeGoal, Tag("cascade")]
    | Annotated[PluginGoal, Tag(_PLUGIN)],
    Discriminator(_kind),
]


class Budget(Document):
    """Limits of a study, which ends when it reaches the first of them.

    Attributes:
        variants: number of legal variants; rejected ones cost nothing and do not count.
        cpu_hours: CPU time of workers for the runs of the study.
        deadline: moment after which nothing more is proposed; UTC unless it names a time zone.
    """

    variants: Annotated[int, Field(strict=True, ge=8, le=1_000_000)]
    cpu_hours: Annotated[float, Field(gt=0, le=1e6)] | None = None
    deadline: Moment | None = None


class StopRule(Document):
    """The precision at which a study ends.

    Attributes:
        width: full width of the assumption-free interval of ``estimate``. The study looks after every batch, so each look
            gets a share of the error (Bonferroni), which makes the interval wider than without a stop rule.
    """

    width: Annotated[Share, Field(gt=0, lt=1)] | None = None


class StudyDocument(Document):
    """The definition of a study.

    Attributes:
        schema_version: version of this schema.
        spec: spec of its runs, with one block that varies the operational domain.
        measure: a statistic over the rows of a variant and its bound, e.g. ``min(pacc) >= 0.5``: variants below it fail.
        where: rows that count, e.g. ``distance_m <= 30``; by default all.
        goal: the question.
        budget: limits of its cost.
        stop: precision that suffices; by default the budget decides.
        batch: number of variants that are proposed at a time.
        mode: ``automatic``, or ``by hand``: a person accepts each batch.
        rounds: how a validation flow goes on where ``verify`` ends with a requirement that is not met.

    Raises:
        InvalidInputs: every problem, each with its dotted field.
    """

    schema_version: Literal[1] = 1
    spec: RunSpec
    measure: Text
    where: Text = ""
    goal: Goal
    budget: Budget
    stop: StopRule = StopRule()
    batch: Annotated[int, Field(strict=True, ge=1, le=1000)] = 64
    mode: Literal["automatic", "by hand"] = "automatic"
    rounds: Rounds = Rounds()

    @model_validator(mode="after")
    def _check(self) -> Self:
        problems: list[InvalidInput] = []
        try:
            measure = parse_measure(self.measure)
        except InvalidInput as problem:
            problems.append(problem)
        else:
            if not 0 < measure.at_least < 1 and self.goal.bounded:
                refusal = f"{self.goal.name} needs scores on both sides of the bound"
                problems.append(InvalidInput(refusal, field="measure", value=self.measure, limit="above 0, below 1"))
        if not self.spec.blocks[0].vary:
            problems.append(InvalidInput("a study needs a parameter that varies", field="vary", limit=">= 1"))
        if (functions := len(self.spec.functions)) != self.goal.functions:
            refusal = (
                f"{self.goal.name} is about {('one function', 'two functions')[self.goal.functions - 1]} under test"
            )
            problems.append(InvalidInput(refusal, field="functions", value=functions, limit=self.goal.functions))
        if isinstance(self.goal, RankGoal) and len(self.spec.blocks[0].vary) == 1:
            problems.append(InvalidInput("a ranking needs two parameters", field="vary", value=1, limit=">= 2"))
        if isinstance(self.goal, CascadeGoal) and self.goal.renderer == self.spec.renderer:
            refusal = "the costly engine is the cheap one"
            problems.append(InvalidInput(refusal, field="goal.renderer", value=self.goal.renderer, limit="another"))
        if self.batch > self.budget.variants:
            refusal = "a batch is larger than the budget"
            problems.append(InvalidInput(refusal, field="batch", value=self.batch, limit=self.budget.variants))
        if self.stop.width is not None and not isinstance(self.goal, EstimateGoal):
            refusal = f"{self.goal.name} has no interval"
            problems.append(InvalidInput(refusal, field="stop.width", value=self.stop.width, limit="goal: estimate"))
        first = self.goal.first if isinstance(self.goal, EstimateGoal) else None
        if first is not None and first > self.budget.variants:
            refusal = "more first points than the budget has"
            problems.append(InvalidInput(refusal, field="goal.first", value=first, limit=self.budget.variants))
        if problems:
            raise InvalidInputs(problems)
        return self

    @property
    def name(self) -> str:
        """Title of the study."""
        return self.spec.name

    @property
    def digest(self) -> str:
        """Digest of everything that determines its proposals; mode and rounds do not."""
        document = self.model_dump(mode="json", exclude={"spec", "mode", "rounds"})
        return digest("study", self.spec.digest, document)

    def to_yaml(self) -> str:
        """Return the document as the text of a file."""
        own = self.model_dump(mode="json", exclude={"spec"}, exclude_defaults=True)
        spec = {name: part for name, part in self.spec.short().items() if name != "blocks"}
        block = self.spec.blocks[0].model_dump(mode="json", exclude_defaults=True, include={"vary"})
        document = {
            "schema_version": 1,
            **spec,
            **block,
            **own,
            "goal": self.goal.model_dump(mode="json", exclude_none=True),
        }
        return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100))


_OWN: Final = frozenset(StudyDocument.model_fields) - {"spec", "schema_version"}


def parse_study(source: str | bytes | Mapping[str, Json] | StudyDocument) -> StudyDocument:
    """Read a study with its spec in either notation.

    Args:
        source: YAML or JSON text, or a loaded document.

    Raises:
        InvalidInput: the text is not a usable document.
        InvalidInputs: every problem of the document, each with its dotted field.
    """
    if isinstance(source, StudyDocument):
        return source
    document = load_document(source)
    problems: list[InvalidInput] = [
        InvalidInput("a study decides this itself", field=key, limit=f"leave {key} out")
        for key in _DECIDED
        if key in document
    ]
    fields = {*_OWN, *RunSpec.model_fields, "vary"} - {*_DECIDED}
    problems += [UnknownName("field", key, fields, field=key) for key in document if key not in {*fields, *_DECIDED}]
    own: JsonObject = {key: value for key, value in document.items() if key in _OWN}
    if isinstance(own.get("goal"), str):
        own["goal"] = {"name": own["goal"]}
    goal = own.get("goal")
    if isinstance(goal, dict) and (name := goal.get("name")) not in (names := plugins.goal_names()):
        problems.append(plugins.unknown_name("goal", str(name), names, field="goal"))
        del own["goal"]
    elif goal is None:
        problems.append(InvalidInput("a study needs a goal", field="goal", limit=", ".join(GOALS)))
    rest = {key: value for key, value in document.items() if key in fields and key not in _OWN}
    spec: RunSpec | None = None
    try:
        spec = parse({**rest, "design": "random", "count": 1})
    except InvalidInputs as error:
        problems += error.problems
    if spec is not None and "goal" in own:
        try:
            study = StudyDocument.model_validate({**own, "spec": spec})
        except ValidationError as error:
            problems += [problem_of(problem, _place(problem["loc"])) for problem in error.errors(include_url=False)]
        except InvalidInputs as error:
            problems += error.problems
        except InvalidInput as error:
            problems.append(error)
    if problems:
        raise InvalidInputs(problems)
    return study


def _place(location: tuple[int | str, ...]) -> str:
    return ".".join(str(part) for part in location if part not in (*GOALS, _PLUGIN))


class Outcomes(Document):
    """The final outcomes of a batch.

    Attributes:
        scores: score of each variant; None if a variant has none.
        second: likewise for the second function; empty in a study of one function.
        rejected: indices of the rejected variants. They have no score and do not count in the budget.
        cpu_seconds: price of all products of the batch, whenever they were made; None where no proposal depends on it.
    """

    scores: tuple[float | None, ...]
    second: tuple[float | None, ...] = ()
    rejected: tuple[int, ...] = ()
    cpu_seconds: float | None = None

    @property
    def by_variant(self) -> list[tuple[float | None, ...]]:
        """The scores of all functions for each variant."""
        return list(zip(self.scores, self.second, strict=True)) if self.second else [(score,) for score in self.scores]

    @property
    def values(self) -> list[float] | list[list[float]]:
        """The scores for a strategy, with NaN for None: one per variant, or one per variant and function."""
        table = [[math.nan if score is None else score for score in scores] for scores in self.by_variant]
        return table if self.second else [score for (score,) in table]

    def failed(self, at_least: float) -> int:
        """Return the number of variants that fail, for any of the functions: a score is below ``at_least``."""
        return sum(any(score is not None and score < at_least for score in scores) for scores in self.by_variant)


class StudyResult(Document):
    """The result of a study.

    Attributes:
        sentences: the result in words.
        numbers: the result by name.
        batches: number of batches behind it.
        further: expected number of further variants until the goal is decided or known as well as requested; None where
            nothing is missing, or the number is not known.
    """

    sentences: tuple[str, ...]
    numbers: dict[str, JsonValue]
    batches: int
    further: int | None = None
