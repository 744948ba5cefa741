from valerie.runs.products.states import ProductKind, RunState, Stage


def test_a_run_that_ended_is_final() -> None:
    final = {state for state in RunState if state.is_final}
    assert final == {"completed", "completed-with-failures", "cancelled", "failed"}


def test_every_product_has_the_stage_that_makes_it() -> None:
    stages = {kind.value: kind.stage for kind in ProductKind}
    assert stages == {
        "background": Stage.RENDER,
        "layer": Stage.RENDER,
        "truth": Stage.RENDER,
        "statics": Stage.RENDER,
        "normals": Stage.RENDER,
        "boxes": Stage.RENDER,
        "joints": Stage.RENDER,
        "light": Stage.RENDER,
        "flow": Stage.RENDER,
        "velocity": Stage.RENDER,
        "scan": Stage.RENDER,
        "prediction": Stage.INFER,
        "evaluation": Stage.EVAL,
    }
