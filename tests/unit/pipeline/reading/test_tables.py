from pathlib import Path

import numpy as np
import orjson
import pytest
from sklearn.metrics import jaccard_score

from tests.world.blank import completed_run
from valerie.analysis.rows.table import EvaluationTable
from valerie.db import frames, long_table, results
from valerie.db.engine import reading
from valerie.labels import to_train_ids
from valerie.pipeline.base.pinning import pinned_card
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.tables import read_classes, read_table, table_row, varied_types
from valerie.storage.keys import run_key


def test_all_classes_are_those_of_the_stored_pictures_and_stand_in_the_summary(tmp_path: Path) -> None:
    pipeline, run_id = completed_run(tmp_path)
    context = pipeline.context
    run = read_run(context, run_id)
    varied = varied_types(run.resolved)
    with reading(context.engine) as connection:
        rows = [table_row(row, run, varied) for row in long_table.rows(connection, run_id)]
    assert read_table(context.engine, run).arrow.equals(EvaluationTable.from_rows(rows, varied).arrow)
    cards = {name: pinned_card(run.pins, name) for name in run.resolved.spec.functions}
    (classes,) = read_classes(context.engine, [run], cards)

    summary = orjson.loads(context.store.get(run_key(run_id, "summary.json")))["summary"]
    assert summary["classes"] == [orjson.loads(orjson.dumps(classes))]

    with reading(context.engine) as connection:
        shown = [frame for frame, _ in frames.page(connection, run_id, limit=100)]
        evaluated = results.predictions(connection, run_id, 0, 0)
    reader = ProductReader(context.store)
    truth = np.concatenate([to_train_ids(reader.truth(frame.products.truth).class_map).ravel() for frame in shown])
    predicted = np.concatenate([reader.prediction(evaluated[frame.key].digest).ravel() for frame in shown])
    labelled = truth < 19
    oracle = jaccard_score(truth[labelled], predicted[labelled], labels=np.unique(truth[labelled]), average=None)
    assert classes.frames == len(shown) == 24
    assert [entry.iou for entry in classes.classes] == pytest.approx(list(oracle))
    assert classes.miou_pooled == pytest.approx(oracle.mean())
