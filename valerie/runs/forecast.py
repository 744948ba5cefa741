"""What a run would be, before anything is stored: its size, what is there already, what the rest costs.

Up to `EXACT_VARIANTS` variants every variant is looked at. Beyond, a seeded sample of them stands for all, and the
plan says ``estimated``. The number of distinct products is then estimated by Chao1 (Chao 1984,
www.jstor.org/stable/4615964): with f₁ products seen once and f₂ seen twice among d distinct ones, d + f₁(f₁ − 1) /
(2(f₂ + 1)); or, where nearly every product was seen once, in proportion.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, ConfigDict

from valerie import plugins
from valerie.parameters.assignment import DIGEST_LENGTH
from valerie.parameters.definitions import Value
from valerie.perception.base import FunctionCard
from valerie.runs.costs import Basis, CostKey, CostTable
from valerie.runs.inputs import FrameDigests, ProductInputs
from valerie.runs.pins import FunctionPin, Offer, Pins
from valerie.runs.resolution import ResolvedRun
from valerie.runs.states import ProductKind, Stage
from valerie.scene.variation.conditions import sun_by_time

#: Largest number of variants that are all looked at.
EXACT_VARIANTS: Final = 100_000
#: Variants in a sample.
SAMPLE: Final = 2_000
#: Variants that are shown from the beginning and from the end.
SHOWN: Final = 3
#: Digests that are asked for at once.
_ASKED: Final = 5_000

#: Products of the renderer, whose settings change their cost.
_BY_ENGINE: Final = (ProductKind.BACKGROUND, ProductKind.LAYER)
#: Which of some digests are stored already.
Present = Callable[[set[str]], set[str]]


class ProductPlan(BaseModel):
    """The products of one kind and maker.

    Attributes:
        kind, maker: what and by which engine or function.
        needed: distinct products that the run links to.
        present: of these, stored already; None where that is not known, and nothing counts as stored.
        cpu_seconds, bytes: of the rest.
        basis: where the cost is known from.
    """

    model_config = ConfigDict(frozen=True)

    kind: ProductKind
    maker: str
    needed: int
    present: int | None
    cpu_seconds: float
    bytes: int
    basis: Basis

    @property
    def to_make(self) -> int:
        return self.needed - (self.present or 0)


class PlannedVariant(BaseModel):
    """One variant, for people.

    Attributes:
        values: by the names that the spec uses.
        sun: azimuth and elevation in degrees that time and place come to; None where the spec gives the angles themselves.
    """

    model_config = ConfigDict(frozen=True)

    index: int
    values: dict[str, Value]
    sun: tuple[float, float] | None = None
    rejection: str | None = None


class Plan(BaseModel):
    """The answer to ``valerie plan``; its fields are those of ``--json``.

    Attributes:
        variants: in the space, rejected ones included.
        accepted: variants that frames are made of.
        rejected: reason to number of variants.
        moments: frames of each variant and camera in the run's sequence; 1 without one.
        frames: accepted variants × cameras × moments.
        evaluations: frames × sensors × functions.
        renders: backgrounds, layers, truths and annotations that must still be rendered.
        inferences: predictions that must still be made.
        products: by kind and maker.
        start_cpu_seconds: of starting the system on one machine, loading the asset and writing the results; 0 where workers
            run already.
        cpu_seconds: of all that must still be made, and of the start, on one core.
        bytes: that it will take in the artifact store.
        cost_basis: where the costs are known from, in words.
        first, last: variants from the beginning and the end.
        units: name of each parameter in these to its unit.
        estimated: rejections, frames and products come from a sample of ``sample`` variants.
        warnings: what the user may not have meant.
        notes: what was assumed.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    asset: str
    spec_digest: str
    variants: int
    accepted: int
    rejected: dict[str, int]
    cameras: tuple[str, ...]
    moments: int = 1
    frames: int
    evaluations: int
    renders: int
    inferences: int
    products: tuple[ProductPlan, ...]
    start_cpu_seconds: float = 0.0
    cpu_seconds: float
    bytes: int
    cost_basis: str
    first: tuple[PlannedVariant, ...]
    last: tuple[PlannedVariant, ...]
    units: dict[str, str]
    estimated: bool
    sample: int | None
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def plan(
    resolved: ResolvedRun,
    *,
    pins: Pins | None = None,
    present: Present | None = None,
    costs: CostTable | None = None,
) -> Plan:
    """Size and cost of a run; stores nothing, needs neither meshes nor GL.

    Args:
        resolved: the run.
        pins: the numeric classes that it would pin; None where no workers offer them: then nothing counts as present.
        present: which of some digests are stored; None: none is.
        costs: recorded timings; None takes the shipped table.
    """
    warnings = list(resolved.warnings)
    known = pins is not None
    if pins is None:
        pins, present = _any_pins(resolved), None
        warnings.append("no running workers offer renderer and functions: what is there already is not known")
    costs = costs or CostTable()
    size = resolved.space.size
    indexes = None if size <= EXACT_VARIANTS else _sample(size, resolved.spec.seed)
    seen = _look(resolved, ProductInputs(resolved, asset_digest=resolved.asset_digest, pins=pins), indexes)
    looked_at = size if indexes is None else len(indexes)

    def scaled(count: int) -> int:
        return count if indexes is None else round(count * size / looked_at)

    rejected = {reason: scaled(count) for reason, count in sorted(seen.rejected.items())}
    accepted = size - sum(rejected.values())
    moments = len(resolved.times.elapsed)
    frames = accepted * len(resolved.cameras) * moments
    products = [
        _product_plan(resolved, kind, maker, digests, scale=None if indexes is None else size / looked_at,
                      present=present, known=known, costs=costs)
        for (kind, maker), digests in seen.digests.items()
    ]  # fmt: skip
    _add_statics(products, seen, resolved, costs, scale=1.0 if indexes is None else size / looked_at)
    start = 0.0 if known or not frames else costs.start_seconds
    first = _shown(resolved, range(min(SHOWN, size)))
    last = _shown(resolved, range(max(size - SHOWN, min(SHOWN, size)), size))
    units = {d.name: d.unit for d in resolved.definitions}
    if indexes is not None:
        warnings.append(
            f"{size:,} variants: rejections, frames and products are estimated from a sample of {looked_at:,}"
        )
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
        products=tuple(products),
        start_cpu_seconds=start,
        cpu_seconds=round(start + sum(product.cpu_seconds for product in products), 3),
        bytes=sum(product.bytes for product in products),
        cost_basis=_basis_text(products, costs),
        first=first,
        last=last,
        units={name: units[name] for one in (*first, *last) for name in one.values},
        estimated=indexes is not None,
        sample=None if indexes is None else looked_at,
        warnings=tuple(warnings),
        notes=resolved.notes,
    )


@dataclass(slots=True)
class _Seen:
    """Digests, each as 16 bytes in a row, by kind and maker; rejections; and how often each camera stood where."""

    digests: dict[tuple[ProductKind, str], bytearray]
    rejected: Counter[str]
    stands: Counter[tuple[Any, ...]]


def _look(resolved: ResolvedRun, inputs: ProductInputs, indexes: list[int] | None) -> _Seen:
    spec = resolved.spec
    seen = _Seen(
        {
            (ProductKind.BACKGROUND, spec.engine): bytearray(),
            (ProductKind.LAYER, spec.engine): bytearray(),
            (ProductKind.TRUTH, ""): bytearray(),
            **{(ProductKind(kind), ""): bytearray() for kind in resolved.annotations},
            **{(ProductKind.PREDICTION, name): bytearray() for name in spec.functions},
            (ProductKind.EVALUATION, ""): bytearray(),
        },
        Counter(),
        Counter(),
    )
    of_camera = [
        [d.path for d in resolved.definitions if d.path.startswith(f"scene.{camera}.")] for camera in resolved.cameras
    ]
    for values in _variants(resolved, indexes):
        reason = resolved.rejection(values)
        if reason is not None:
            seen.rejected[reason] += 1
            continue
        for time in range(len(resolved.times.elapsed)):
            moment = resolved.at(values, time)
            for camera in range(len(resolved.cameras)):
                seen.stands[camera, *(moment.get(path) for path in of_camera[camera])] += 1
                _note(seen, resolved, inputs.frame(moment, camera, near=partial(resolved.near, values, time)))
    return seen


def _note(seen: _Seen, resolved: ResolvedRun, frame: FrameDigests) -> None:
    spec, digests = resolved.spec, seen.digests
    products = frame.products
    digests[ProductKind.BACKGROUND, spec.engine] += bytes.fromhex(products.background)
    digests[ProductKind.LAYER, spec.engine] += bytes.fromhex(products.layer)
    digests[ProductKind.TRUTH, ""] += bytes.fromhex(products.truth)
    for annotation in frame.annotations:
        digests[annotation.kind, ""] += bytes.fromhex(annotation.product)
    for one in frame.evaluations:
        digests[ProductKind.PREDICTION, spec.functions[one.function_index]] += bytes.fromhex(one.prediction)
        digests[ProductKind.EVALUATION, ""] += bytes.fromhex(one.scores)


def _variants(resolved: ResolvedRun, indexes: list[int] | None) -> Iterator[Mapping[str, Value]]:
    if indexes is None:
        for _, values in resolved.space.values(0, resolved.space.size):
            yield values
    else:
        for index in indexes:
            yield resolved.space[index].values


def _sample(size: int, seed: int) -> list[int]:
    """`SAMPLE` different indexes below ``size``, ascending; one from each of as many equal stretches of the space."""
    generator = np.random.default_rng(seed)
    places = generator.random(SAMPLE)
    # Whole-number arithmetic: a space may hold more variants than a float can tell apart.
    return [i * size // SAMPLE + int(place * (size // SAMPLE)) for i, place in enumerate(places.tolist())]


def _product_plan(
    resolved: ResolvedRun,
    kind: ProductKind,
    maker: str,
    digests: bytearray,
    *,
    scale: float | None,
    present: Present | None,
    known: bool,
    costs: CostTable,
) -> ProductPlan:
    distinct, counts = np.unique(np.frombuffer(digests, f"S{DIGEST_LENGTH // 2}"), return_counts=True)
    found = 0
    if present is not None:
        for first in range(0, len(distinct), _ASKED):
            # numpy drops a byte string's trailing zeros.
            asked = {d.ljust(DIGEST_LENGTH // 2, b"\0").hex() for d in distinct[first : first + _ASKED].tolist()}
            found += len(present(asked) & asked)
    needed = len(distinct)
    if scale is not None and needed:
        share = found / needed
        needed = _estimated_distinct(counts, scale)
        found = round(needed * share)
    resolution = resolved.spec.resolution
    cost, basis = costs.cost(CostKey(kind, maker, resolution.width, resolution.height))
    work = plugins.engine_cost(maker, resolved.spec.engine_settings) if kind in _BY_ENGINE else 1.0
    return ProductPlan(
        kind=kind,
        maker=maker,
        needed=needed,
        present=found if known else None,
        cpu_seconds=(needed - found) * cost.cpu_seconds * work,
        bytes=round((needed - found) * cost.bytes),
        basis=basis,
    )


def _add_statics(
    products: list[ProductPlan], seen: _Seen, resolved: ResolvedRun, costs: CostTable, *, scale: float
) -> None:
    """Add what the truths share to what they cost: the truth of the statics, once wherever a camera stands.

    Where some truths are there already, as many of these are taken to be.
    """
    place = next(i for i, product in enumerate(products) if product.kind is ProductKind.TRUTH)
    truth = products[place]
    if not truth.to_make:
        return
    counts = np.array(list(seen.stands.values()))
    stands = len(counts) if scale == 1.0 else _estimated_distinct(counts, scale)
    resolution, share = resolved.spec.resolution, truth.to_make / truth.needed
    cost = costs.statics(resolution.width, resolution.height)
    products[place] = truth.model_copy(
        update={
            "cpu_seconds": truth.cpu_seconds + stands * share * cost.cpu_seconds,
            "bytes": truth.bytes + round(stands * share * cost.bytes),
        }
    )


def _estimated_distinct(counts: Any, scale: float) -> int:
    """Distinct products among all, from how often each was seen in a sample of 1/``scale`` of them."""
    distinct, total = len(counts), int(counts.sum())
    once, twice = int((counts == 1).sum()), int((counts == 2).sum())
    if once > 0.9 * distinct:
        return round(distinct * scale)
    return min(round(distinct + once * (once - 1) / (2 * (twice + 1))), round(total * scale))


def _shown(resolved: ResolvedRun, indexes: range) -> tuple[PlannedVariant, ...]:
    return tuple(
        PlannedVariant(
            index=index,
            values={resolved.space.definitions[path].name: value for path, value in values.items()},
            sun=sun_by_time(values, resolved.manifest),
            rejection=resolved.rejection(values),
        )
        for index in indexes
        for values in (resolved.space[index].values,)
    )


def _any_pins(resolved: ResolvedRun) -> Pins:
    """Return pins that keep different products apart and equal none that is stored."""
    render = Offer(stage=Stage.RENDER, name="", numeric_class="", revision=0, route="")
    functions = {
        name: FunctionPin(
            stage=Stage.INFER, name=name, numeric_class="", revision=0, route="", digest=name,
            card=FunctionCard(name, name, "", "", "", {}),
        )
        for name in resolved.spec.functions
    }  # fmt: skip
    return Pins(engine=render, truth=render, functions=functions)


def _basis_text(products: list[ProductPlan], costs: CostTable) -> str:
    by_basis: dict[Basis, list[str]] = {}
    for product in products:
        if product.needed:
            by_basis.setdefault(product.basis, []).append(" ".join(filter(None, (product.kind.value, product.maker))))
    texts = {
        Basis.RECORDED: "recorded here: {}",
        Basis.SHIPPED: f"shipped table ({costs.machine}): {{}}",
        Basis.GUESSED: "guessed, since nothing is known of them: {}",
    }
    return "; ".join(texts[basis].format(", ".join(names)) for basis, names in sorted(by_basis.items()))
