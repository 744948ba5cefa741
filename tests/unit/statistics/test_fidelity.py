import numpy as np
import pytest
from sklearn.metrics import accuracy_score, cohen_kappa_score

from valerie.errors import InvalidInput
from valerie.statistics.fidelity import instance_fidelity
from valerie.statistics.units import sampling_units

PERSONS = 400
UNITS = sampling_units("random", np.arange(PERSONS))


@pytest.mark.parametrize("flipped", [0.0, 0.1, 0.5, 0.9])
def test_share_and_kappa_are_those_of_scikit_learn(flipped: float) -> None:
    generator = np.random.default_rng(int(10 * flipped))
    here = generator.random(PERSONS) < 0.3
    there = here ^ (generator.random(PERSONS) < flipped)
    fidelity = instance_fidelity(here, there, UNITS)
    assert fidelity.persons == PERSONS
    assert fidelity.share == pytest.approx(accuracy_score(here, there))
    assert fidelity.kappa == pytest.approx(cohen_kappa_score(here, there))
    assert fidelity.low is not None
    assert fidelity.high is not None
    assert fidelity.low <= fidelity.share <= fidelity.high


def test_equal_rates_of_misses_may_be_of_other_persons() -> None:
    here = np.arange(PERSONS) < 100
    fidelity = instance_fidelity(here, np.roll(here, 100), UNITS)
    assert (fidelity.both, fidelity.only_here, fidelity.only_there, fidelity.neither) == (0, 100, 100, 200)
    assert fidelity.missed_here == 100
    assert fidelity.kappa is not None
    assert fidelity.kappa < 0


def test_listed_scenes_have_no_interval() -> None:
    same = np.zeros(PERSONS, np.bool_)
    fidelity = instance_fidelity(same, same, sampling_units("grid", np.arange(PERSONS)))
    assert (fidelity.share, fidelity.low, fidelity.high) == (1.0, None, None)
    assert fidelity.missed_here == 0
    assert fidelity.kappa is None


@pytest.mark.parametrize(("here", "there"), [(0, 0), (3, 2)])
def test_persons_without_both_sides_are_refused(here: int, there: int) -> None:
    with pytest.raises(InvalidInput, match="both sides"):
        instance_fidelity(np.zeros(here, np.bool_), np.zeros(there, np.bool_), UNITS)
