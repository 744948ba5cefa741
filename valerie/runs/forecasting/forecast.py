"""Forecast of a run before anything is stored: its size, the products that are present, and the cost of the rest.

In a run of up to `EXACT_VARIANTS` variants, every variant is examined. In a larger one, a seeded sample represents all,
and the plan is marked ``estimated``. The number of distinct products is then the Chao1 estimate (Chao 1984,
www.jstor.org/stable/4615964): with f₁ products seen once and f₂ seen twice among d distinct ones, d + f₁(f₁ − 1) /
(2(f₂ + 1)). Where nearly every product was seen once, the number grows in proportion to the variants.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie import plugins
from valerie.parameters.assignment import DIGEST_LENGTH
from valerie.parameters.definitions import Value
from valerie.perception.base import FunctionCard
from valerie.runs.document.run_spec import SAMPLED, Retention, RunSpec
from valerie.runs.forecasting.costs import Cost, CostBasis, CostKey, CostTable
from valerie.runs.forecasting.plan import Plan, PlannedVariant, ProductPlan
from valerie.runs.products.inputs import FrameDigests, ProductInputs
from valerie.runs.products.pins import FunctionPin, Offer, Pins
from valerie.runs.products.states import ProductKind, Stage
from valerie.runs.resolving.resolution import ResolvedRun
from valerie.scene.variation.conditions import sun_by_time

#: Largest number of frames at which all are examined, and of frames of sequences, which take much longer.
EXACT_FRAMES: Final = 40_000
EXACT_MOVING_FRAMES: Final = 2_000
#: Most variants in a sample, and most moments of each.
SAMPLE: Final = 2_000
MOMENTS: Final = 20
#: Number of variants that a plan shows from the beginning, and from the end.
SHOWN: Final = 3
#: Largest number of digests in one query.
_QUERY_SIZE: Final = 5_000

#: Products whose cost depends on the settings of the renderer.
_BY_ENGINE: Final = (ProductKind.BACKGROUND, ProductKind.LAYER)
#: Returns the subset of the digests that are stored.
Present = Callable[[set[str]], set[str]]


def plan(
    resolved: ResolvedRun,
    *,
    pins: Pins | None = None,
    tenant: str = "",
    present: Present | None = None,
    costs: CostTable | None = None,
    exact_frames: int = EXACT_FRAMES,
) -> Plan:
    """Return the size and cost of a run. Nothing is stored, and neither meshes nor OpenGL are needed.

    Args:
        resolved: the run.
        pins: the numeric classes that the run would pin; None if no workers offer them, and then no product counts as
            present.
        tenant: of the run (`valerie.runs.products.inputs.ProductInputs`).
        present: returns the digests that are stored; None if none is.
        costs: recorded timings; None takes the shipped table.
        exact_frames: largest number of frames at which all are examined.
    """
    warnings = list(resolved.warnings)
    workers_known = pins is not None
    if pins is None:
        pins, present = _any_pins(resolved), None
    size, moments = resolved.space.size, len(resolved.times.elapsed)
    extent = _extent(resolved, exact_frames)
    survey = _survey(resolved, pins, tenant, extent)
    sampled = len(extent.variants)
    rejected = {reason: round(count * size / sampled) for reason, count in sorted(survey.rejected.items())}
    accepted = size - sum(rejected.values())
    frames = accepted * len(resolved.cameras) * moments
    forecast = _Forecast(resolved, survey, costs or CostTable(), present, workers_known, extent.scale)
    products = forecast.products()
    start = 0.0 if workers_known or not frames else forecast.costs.start_seconds
    first = planned_variants(resolved, range(min(SHOWN, size)), extent.moments)
    last = planned_variants(resolved, range(max(size - SHOWN, min(SHOWN, size)), size), extent.moments)
    units = {d.name: d.unit for d in resolved.definitions}
    if extent.scale is not None:
        of = f"{moments:,} moments of {size:,}" if moments > 1 else f"{size:,}"
        at = f" at {len(extent.moments):,} moments" if moments > 1 else ""
        warnings.append(
            f"{of} variants: rejections, frames and products are estimated from a sample of {sampled:,}{at}"
        )
    made = sum(product.bytes for product in products)
    thumbnails = forecast.thumbnails(frames)
    notes = resolved.notes
    if not workers_known:
        notes += (
            "no running worker offers the renderer and the functions, so products stored already are counted, too",
        )
    if resolved.spec.retention is not Retention.ALL:
        left = f"numbers, report and up to {thumbnails.bytes / 1e6:,.1f} MB of thumbnails"
        if resolved.spec.retention is Retention.FAILURES:
            left = f"about {made / SAMPLED / 1e6:,.0f} MB, the frames with failures and thumbnails of the others"
        notes += (f"retention: of {(made + thumbnails.bytes) / 1e6:,.0f} MB, {left} stay when the run completes",)
    if size and not accepted:
        warnings.append("every variant is rejected: the run would make no frame")
    return Plan(
        name=resolved.spec.name,
        asset=resolved.manifest.name,
        spec_digest=resolved.spec.digest,
        variants=size,
        accepted=accepted,
        rejected=rejected,
        cameras=resolved.cameras,
        moments=moments,
        frames=frames,
        evaluations=frames * len(resolved.spec.sensors) * len(resolved.spec.functions),
        renders=sum(product.to_make for product in products if product.kind.stage is Stage.RENDER),
        inferences=sum(product.to_make for product in products if product.kind is ProductKind.PREDICTION),
        products=products,
        start_cpu_seconds=start,
        cpu_seconds=round(start + sum(product.cpu_seconds for product in products) + thumbnails.cpu_seconds, 3),
        bytes=made + round(thumbnails.bytes),
        cost_basis=_basis_text(products, forecast.costs),
        first=first,
        last=last,
        units={name: units[name] for variant in (*first, *last) for name in variant.values},
        estimated=extent.scale is not None,
        sample=None if extent.scale is None else sampled,
        warnings=tuple(warnings),
        notes=notes,
    )


@dataclass(slots=True)
class _Survey:
    """Counts over the frames of some variants.

    Attributes:
        digests: concatenated digests of the products, 16 bytes each, by kind and maker.
        empty: likewise of predictions of backgrounds without movables, by function.
        rejected: reason to number of variants.
        camera_poses: frames by camera index and values of the camera's parameters.
    """

    digests: dict[tuple[ProductKind, str], bytearray]
    empty: dict[str, bytearray]
    rejected: Counter[str]
    camera_poses: Counter[tuple[Any, ...]]

    def add(self, spec: RunSpec, frame: FrameDigests) -> None:
        """Add the digests of a frame."""
        products, digests = frame.products, self.digests
        digests[ProductKind.BACKGROUND, spec.engine] += bytes.fromhex(products.background)
        digests[ProductKind.LAYER, spec.engine] += bytes.fromhex(products.layer)
        digests[ProductKind.TRUTH, ""] += bytes.fromhex(products.truth)
        for annotation in frame.annotations:
            digests[annotation.kind, ""] += bytes.fromhex(annotation.product)
        for evaluation in frame.evaluations:
            function = spec.functions[evaluation.function_index]
            digests[ProductKind.PREDICTION, function] += bytes.fromhex(evaluation.prediction)
            digests[ProductKind.EVALUATION, ""] += bytes.fromhex(evaluation.scores)
            if evaluation.empty is not None:
                self.empty.setdefault(function, bytearray()).extend(bytes.fromhex(evaluation.empty))


@dataclass(frozen=True, slots=True)
class _Extent:
    """What a plan examines.

    Attributes:
        variants: indexes in the space, ascending.
        moments: indexes of the moments of each.
        scale: frames of the run per examined frame; None if all are.
    """

    variants: Sequence[int]
    moments: Sequence[int]
    scale: float | None


def _extent(resolved: ResolvedRun, exact_frames: int) -> _Extent:
    size, moments, cameras = resolved.space.size, len(resolved.times.elapsed), len(resolved.cameras)
    most = exact_frames if resolved.times.motion is None else min(exact_frames, EXACT_MOVING_FRAMES)
    if size * moments * cameras <= most:
        return _Extent(range(size), range(moments), None)
    # Both ends of the sequence are among the moments.
    looked_at = sorted({round(place) for place in np.linspace(0, moments - 1, min(moments, MOMENTS)).tolist()})
    count = min(size, SAMPLE, max(1, most // (cameras * len(looked_at))))
    variants = _sample(size, count, resolved.spec.seed)
    return _Extent(variants, looked_at, size * moments / (count * len(looked_at)))


def _survey(resolved: ResolvedRun, pins: Pins, tenant: str, extent: _Extent) -> _Survey:
    spec = resolved.spec
    by_pins = {
        id(one): ProductInputs(resolved, asset_digest=resolved.asset_digest, pins=one, tenant=tenant)
        for one in pins.combinations()
    }
    survey = _Survey(
        {
            (ProductKind.BACKGROUND, spec.engine): bytearray(),
            (ProductKind.LAYER, spec.engine): bytearray(),
            (ProductKind.TRUTH, ""): bytearray(),
            **{(ProductKind(kind), ""): bytearray() for kind in resolved.annotations},
            **{(ProductKind.PREDICTION, name): bytearray() for name in spec.functions},
            (ProductKind.EVALUATION, ""): bytearray(),
        },
        {},
        Counter(),
        Counter(),
    )
    camera_paths = [
        [d.path for d in resolved.definitions if d.path.startswith(f"scene.{camera}.")] for camera in resolved.cameras
    ]
    variants = list(_variants(resolved, extent.variants))
    for values, reason in zip(variants, resolved.rejections(variants, extent.moments), strict=True):
        if reason is not None:
            survey.rejected[reason] += 1
            continue
        inputs = by_pins[id(pins.at(values))]
        for time in extent.moments:
            moment = resolved.at(values, time)
            for camera in range(len(resolved.cameras)):
                survey.camera_poses[camera, *(moment.get(path) for path in camera_paths[camera])] += 1
                survey.add(spec, inputs.frame(moment, camera, course=resolved.around(values, time)))
    return survey


def _variants(resolved: ResolvedRun, indexes: Sequence[int]) -> Iterator[Mapping[str, Value]]:
    if len(indexes) == resolved.space.size:
        for _, values in resolved.space.values(0, resolved.space.size):
            yield values
    else:
        for index in indexes:
            yield resolved.space[index].values


def _sample(size: int, count: int, seed: int) -> list[int]:
    """Draw ``count`` distinct indices below ``size``, ascending, one from each of ``count`` equal parts of the space."""
    generator = np.random.default_rng(seed)
    places = generator.random(count)
    # Integer arithmetic, since a space may have more variants than a float can represent exactly.
    return [i * size // count + int(place * (size // count)) for i, place in enumerate(places.tolist())]


@dataclass(frozen=True, slots=True)
class _Forecast:
    """Estimates of products and their costs from a survey.

    Attributes:
        resolved: the run.
        survey: survey of its variants or a sample of them.
        costs: costs of products.
        present: see `plan`.
        workers_known: True if the digests are those of the run's products.
        scale: frames of the run per frame in the survey; None if all were surveyed.
    """

    resolved: ResolvedRun
    survey: _Survey
    costs: CostTable
    present: Present | None
    workers_known: bool
    scale: float | None

    def products(self) -> tuple[ProductPlan, ...]:
        """Return the products by kind and maker, in the order of the survey."""
        plans = (self._product(kind, maker, digests) for (kind, maker), digests in self.survey.digests.items())
        empty = (
            self._product(ProductKind.PREDICTION, function, digests).model_copy(update={"empty": True})
            for function, digests in self.survey.empty.items()
        )
        return (*(self._with_statics(plan) if plan.kind is ProductKind.TRUTH else plan for plan in plans), *empty)

    def thumbnails(self, frames: int) -> Cost:
        """Return the cost of the thumbnails that remain of so many frames (`valerie.pipeline.reading.kept_thumbnails`).

        Each person of the asset counts as seen in every frame, and each frame as removed unless it is in the sample.
        """
        spec = self.resolved.spec
        if spec.retention is Retention.ALL:
            return Cost(0.0, 0.0)
        removed = frames if spec.retention is Retention.NUMBERS else frames * (1 - 1 / SAMPLED)
        pictures = len(spec.sensors) * (1 + len(spec.functions))
        count = removed * pictures * (1 + len(self.resolved.manifest.persons))
        cost = self.costs.thumbnail(spec.resolution.width, spec.resolution.height)
        return Cost(count * cost.cpu_seconds, count * cost.bytes)

    def _product(self, kind: ProductKind, maker: str, digests: bytearray) -> ProductPlan:
        distinct, counts = np.unique(np.frombuffer(digests, f"S{DIGEST_LENGTH // 2}"), return_counts=True)
        present = 0
        if self.present is not None:
            for start in range(0, len(distinct), _QUERY_SIZE):
                # numpy drops the trailing zeros of a byte string.
                query = {
                    d.ljust(DIGEST_LENGTH // 2, b"\0").hex() for d in distinct[start : start + _QUERY_SIZE].tolist()
                }
                present += len(self.present(query) & query)
        needed = len(distinct)
        if self.scale is not None and needed:
            share = present / needed
            needed = _estimated_distinct(counts, self.scale)
            present = round(needed * share)
        spec = self.resolved.spec
        cost, basis = self.costs.cost(CostKey(kind, maker, spec.resolution.width, spec.resolution.height))
        factor = plugins.engine_cost(maker, spec.engine_settings) if kind in _BY_ENGINE else 1.0
        return ProductPlan(
            kind=kind,
            maker=maker,
            needed=needed,
            present=present if self.workers_known else None,
            cpu_seconds=(needed - present) * cost.cpu_seconds * factor,
            bytes=round((needed - present) * cost.bytes),
            basis=basis,
        )

    def _with_statics(self, truth: ProductPlan) -> ProductPlan:
        """Add the cost of the truth of the statics, which is computed once for each pose of a camera.

        The share that is present is assumed to equal that of the truths.
        """
        if not truth.to_make:
            return truth
        counts = np.array(list(self.survey.camera_poses.values()))
        poses = len(counts) if self.scale is None else _estimated_distinct(counts, self.scale)
        resolution, share = self.resolved.spec.resolution, truth.to_make / truth.needed
        cost = self.costs.statics(resolution.width, resolution.height)
        return truth.model_copy(
            update={
                "cpu_seconds": truth.cpu_seconds + poses * share * cost.cpu_seconds,
                "bytes": truth.bytes + round(poses * share * cost.bytes),
            }
        )


def _estimated_distinct(counts: NDArray[np.int64], scale: float) -> int:
    """Estimate the number of distinct products.

    Args:
        counts: number of occurrences of each product in a sample.
        scale: size of the whole divided by that of the sample.
    """
    distinct, total = len(counts), int(counts.sum())
    once, twice = int((counts == 1).sum()), int((counts == 2).sum())
    if once > 0.9 * distinct:
        return round(distinct * scale)
    return min(round(distinct + once * (once - 1) / (2 * (twice + 1))), round(total * scale))


def planned_variants(
    resolved: ResolvedRun, indexes: Iterable[int], moments: Sequence[int] | None = None
) -> tuple[PlannedVariant, ...]:
    """Return variants as people read them, by their indexes in the space; ``moments`` as in `ResolvedRun.rejection`."""
    return tuple(
        PlannedVariant(
            index=index,
            values={resolved.space.definitions[path].name: value for path, value in values.items()},
            sun=sun_by_time(values, resolved.manifest),
            rejection=resolved.rejection(values, moments),
        )
        for index in indexes
        for values in (resolved.space[index].values,)
    )


def _any_pins(resolved: ResolvedRun) -> Pins:
    """Return pins under which different products have different digests, none of them stored."""
    render = Offer(stage=Stage.RENDER, name="", numeric_class="", revision=0, route="")
    functions = {
        name: FunctionPin(
            stage=Stage.INFER, name=name, numeric_class="", revision=0, route="", digest=name,
            card=FunctionCard(name, name, "", "", "", {}),
        )
        for name in resolved.spec.functions
    }  # fmt: skip
    return Pins(engine=render, truth=render, functions=functions)


def _basis_text(products: tuple[ProductPlan, ...], costs: CostTable) -> str:
    by_basis: dict[CostBasis, dict[str, None]] = {}
    for product in products:
        if product.needed:
            by_basis.setdefault(product.basis, {})[" ".join(filter(None, (product.kind.value, product.maker)))] = None
    texts = {
        CostBasis.RECORDED: "recorded here: {}",
        CostBasis.SHIPPED: f"shipped table ({costs.machine}): {{}}",
        CostBasis.GUESSED: "guessed, since nothing is known about them: {}",
    }
    return "; ".join(texts[basis].format(", ".join(names)) for basis, names in sorted(by_basis.items()))
