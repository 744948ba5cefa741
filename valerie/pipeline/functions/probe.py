"""``python -m valerie.pipeline.functions.probe render|infer NAME …``: print this machine's offers and specimens as JSON.

Standard input has the keys of stored specimens, which it does not make again.

It runs as a separate process, since a driver may crash and a worker's supervising process never loads GL or torch. There is one
for each engine, so it imports neither database nor planning.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from valerie import plugins
from valerie.addresses import parse_allowed
from valerie.errors import ValerieError
from valerie.perception.documents.function import PRECISIONS, FunctionDocument
from valerie.perception.running.small_network import small_onnx
from valerie.perception.shipped import FUNCTIONS, file_document, function_path
from valerie.pipeline.functions.opening import open_function_document, open_installed
from valerie.pipeline.functions.specimen_making import Specimens, add_image, add_prediction, add_truth
from valerie.runs.products.pins import TRUTH, AnyOffer, FunctionOffer, Offer, Probed
from valerie.runs.products.states import Stage, route_of
from valerie.settings import load_settings

#: Name under which workers offer to call functions behind HTTP.
HTTP: Final = "http"
#: Engines and functions that make a specimen. Plug-ins may take any time and memory. The noise of a path tracer differs between
#: classes, and its first frame on a new card may take minutes.
_KNOWN: Final = frozenset({"raster", "pyrender", plugins.TESTING_ENGINE, *FUNCTIONS})


def probe_engine(name: str, specimens: Specimens | None = None) -> list[AnyOffer]:
    """Return the offers of one render engine and of the truth pass beside it; add their specimens to ``specimens``."""
    with closing(plugins.create_renderer(name)) as renderer:
        engine = _offer(Stage.RENDER, name, renderer.numeric_class, renderer.revision)
        if specimens is not None and name in _KNOWN:
            add_image(specimens, engine, renderer)
    truth_pass = plugins.create_truth_pass(name if name == plugins.TESTING_ENGINE else "")
    truth = _offer(Stage.RENDER, TRUTH, truth_pass.numeric_class, truth_pass.revision)
    if specimens is not None:
        add_truth(specimens, truth, truth_pass)
    return [engine, truth]


def _offer(stage: Stage, name: str, numeric_class: str, revision: int) -> Offer:
    # Each engine has its queue; all functions of a class share one.
    route = route_of(stage, name, numeric_class) if stage is Stage.RENDER else route_of(stage, numeric_class)
    return Offer(stage=stage, name=name, numeric_class=numeric_class, revision=revision, route=route)


def probe_function(name: str, specimens: Specimens | None = None) -> list[AnyOffer]:
    """Return the offer of an installed function under test, or of an inference engine (see `inference_names`).

    Its specimen is added to ``specimens``.
    """
    if name in inference_names():
        return probe_inference(name, specimens)
    settings = load_settings()
    with closing(open_installed(name, settings, threads=settings.inference_threads)) as function:
        plain = _offer(Stage.INFER, name, function.numeric_class, function.revision)
        offer = FunctionOffer(**dict(plain), digest=function.card.digest, card=function.card)
        if specimens is not None and name in _KNOWN:
            add_prediction(specimens, offer, function)
    return [offer]


def probe_inference(name: str, specimens: Specimens | None = None) -> list[AnyOffer]:
    """Return the offer of an inference engine in one precision, for registered functions: ``torch/bf16``, ``http``.

    The specimen of its small network is added to ``specimens``; functions behind HTTP have none.
    """
    settings = load_settings()
    if name == HTTP:
        if not settings.http_addresses:
            return []
        parse_allowed(settings.http_addresses, field="VALERIE_HTTP_FUNCTIONS")
        from valerie.perception.running.http_function import HttpFunction

        return [_offer(Stage.INFER, HTTP, HTTP, HttpFunction.revision)]
    engine, _, precision = name.partition("/")
    with TemporaryDirectory(prefix="valerie-probe-") as folder:
        document, path = _sample(engine, precision, Path(folder))
        opened = open_function_document(document, path, settings, threads=settings.inference_threads)
        with closing(opened) as function:
            offer = _offer(Stage.INFER, name, function.numeric_class, function.revision)
            if specimens is not None:
                add_prediction(specimens, offer, function)
    return [offer]


def inference_names() -> tuple[str, ...]:
    """Return every inference engine in each of its precisions, and ``http``."""
    engines = ((engine, precisions) for engine, precisions in PRECISIONS.items() if engine != "none")
    return (*(f"{engine}/{precision}" for engine, precisions in engines for precision in precisions), HTTP)


def _sample(engine: str, precision: str, folder: Path) -> tuple[FunctionDocument, Path]:
    """Return a function that an engine opens quickly."""
    if engine == "torch":
        path = function_path(FUNCTIONS[0])
        document = file_document(FUNCTIONS[0], path)
        return document.model_copy(update={"engine": engine, "precision": precision}), path
    return small_onnx(folder, engine=engine, precision=precision)


_PROBES: Final[dict[str, Callable[[str, Specimens], Sequence[AnyOffer]]]] = {
    Stage.RENDER: probe_engine,
    Stage.INFER: probe_function,
}


def main(arguments: Sequence[str]) -> int:
    """Print offers and new specimens of all names that work, errors to standard error; return 1 only if nothing works."""
    stage, *names = arguments
    offers: list[AnyOffer] = []
    stored = frozenset(sys.stdin.read().split())
    specimens: Specimens = dict.fromkeys(stored, b"")
    for name in names:
        try:
            offers += _PROBES[stage](name, specimens)
        except ValerieError as error:
            print(f"{name}: {error}", file=sys.stderr)  # noqa: T201
        except Exception as error:  # a defect of one plug-in must not hide the others
            print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)  # noqa: T201
    new = {key: data for key, data in specimens.items() if key not in stored}
    print(Probed(offers=tuple(offers), specimens=new).model_dump_json())  # noqa: T201
    return 0 if offers else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
