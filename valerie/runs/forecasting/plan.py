"""The size and cost of a run, as ``valerie plan`` and ``POST /v1/plan`` answer them."""

from __future__ import annotations

from pydantic import ConfigDict

from valerie.document import Document
from valerie.parameters.definitions import Value
from valerie.runs.forecasting.costs import Cost, CostBasis
from valerie.runs.products.states import ProductKind


class _Planned(Document):
    # A client reads it; a newer server may send more fields.
    model_config = ConfigDict(extra="ignore")


class ProductPlan(_Planned):
    """The products of one kind and maker.

    Attributes:
        kind, maker: of the products; see `valerie.runs.forecasting.costs.CostKey`.
        empty: True for predictions of backgrounds without movables.
        needed: number of distinct products in the run.
        present: number of these that are stored; None if unknown, in which case none counts as stored.
        cpu_seconds, bytes: cost of the products that are not stored.
        basis: source of the cost.
    """

    kind: ProductKind
    maker: str
    needed: int
    present: int | None
    cpu_seconds: float
    bytes: int
    basis: CostBasis
    empty: bool = False

    @property
    def to_make(self) -> int:
        """Number of products that are not stored yet."""
        return self.needed - (self.present or 0)


class PlannedVariant(_Planned):
    """One variant with the names of the spec.

    Attributes:
        index: index in the space.
        values: name in the spec to value.
        sun: azimuth and elevation in degrees that follow from time and place; None if the spec gives the angles.
        rejection: reason why the variant is rejected; None if it is accepted.
    """

    index: int
    values: dict[str, Value]
    sun: tuple[float, float] | None = None
    rejection: str | None = None


class Plan(_Planned):
    """The result of ``valerie plan``; ``--json`` prints these fields.

    Attributes:
        name: name of the run.
        asset: name of its asset.
        spec_digest: digest of the spec.
        variants: number in the space, rejected ones included.
        accepted: number of variants that have frames.
        rejected: reason to number of variants.
        cameras: names of the cameras.
        moments: frames of each variant and camera in the run's sequence; 1 without a sequence.
        frames: accepted variants × cameras × moments.
        evaluations: frames × sensors × functions.
        renders: number of backgrounds, layers, truths and annotations that remain to be rendered.
        inferences: number of predictions that remain to be made.
        products: products by kind and maker.
        start_cpu_seconds: for starting the system on one machine, loading the asset and writing the results; 0 if workers
            already run.
        cpu_seconds: total on one core, for the start, all remaining products and thumbnails.
        bytes: size of the remaining products in the artifact store, and of thumbnails of pictures that are to be removed.
        cost_basis: sources of the costs, in words.
        first, last: variants from the beginning and the end.
        units: name of each parameter in these to its unit.
        estimated: True if rejections, frames and products are estimated from a sample of ``sample`` variants.
        warnings: properties of the spec that its author may not have intended.
        notes: assumptions made where the spec leaves something open.
    """

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

    @property
    def known_cost(self) -> Cost:
        """The cost of the remaining products whose costs were measured, here or for the shipped table."""
        known = [product for product in self.products if product.basis is not CostBasis.GUESSED]
        return Cost(sum(product.cpu_seconds for product in known), sum(product.bytes for product in known))
