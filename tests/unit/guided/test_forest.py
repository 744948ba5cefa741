"""The forest, against scikit-learn's."""

from __future__ import annotations

import numpy as np
from sklearn.ensemble import RandomForestRegressor

from valerie.guided.forest import Forest


def test_predictions_and_held_out_predictions_are_those_of_scikit_learn() -> None:
    rng = np.random.default_rng(5)
    features, asked = rng.random((150, 4)), rng.random((40, 4))
    values = np.eye(3)[np.where(features[:, 1] > 0.8, 2, features[:, 0] + 0.2 * rng.normal(size=150) < 0.4).astype(int)]
    peer = RandomForestRegressor(30, min_samples_leaf=2, oob_score=True, random_state=0).fit(features, values)
    forest = Forest(features, values, 30)
    assert np.array_equal(forest.held_out, peer.oob_prediction_)
    assert np.array_equal(forest.predict(asked), peer.predict(asked))
