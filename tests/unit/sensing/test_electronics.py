import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.sensing.electronics import break_pixels, expose
from valerie.sensing.settings import FaultyPixels, Noise

SATURATED = 2.0**2.5


def counted(electrons: float, noise: Noise, n: int = 200_000, seed: int = 1) -> np.ndarray:
    """Return ``n`` counts, in electrons, of a pixel that frees ``electrons`` on average."""
    scale = noise.full_well_electrons / 2.0**noise.headroom_ev
    values = np.full(n, electrons / scale, np.float32)
    return expose(values, noise, generator=np.random.default_rng(seed)).astype(np.float64) * scale


@pytest.mark.parametrize("electrons", [20.0, 50.0, 63.9, 64.1, 300.0, 4000.0])
@pytest.mark.parametrize("read", [0.0, 3.0])
def test_counts_have_mean_and_variance_of_the_poisson_gauss_model(electrons: float, read: float) -> None:
    counts = counted(electrons, Noise(shot=True, read_electrons=read))
    variance = electrons + read**2
    assert abs(counts.mean() - electrons) < 5 * np.sqrt(variance / counts.size)
    # The variance of a sample variance of a near-normal distribution is 2σ⁴/n.
    assert abs(counts.var() - variance) < 6 * variance * np.sqrt(2.2 / counts.size)


def test_few_photons_come_in_whole_numbers() -> None:
    counts = counted(3.0, Noise(shot=True))
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-3)
    dark = np.exp(-3.0)
    assert abs((counts < 0.5).mean() - dark) < 5 * np.sqrt(dark * (1 - dark) / counts.size)


def test_read_noise_alone_does_not_depend_on_the_light() -> None:
    for electrons in (200.0, 5000.0):
        counts = counted(electrons, Noise(read_electrons=20.0))
        # The standard deviation of a sample standard deviation is σ/√2n.
        assert abs(counts.std() - 20.0) < 5 * 20.0 / np.sqrt(2 * counts.size)


def test_the_normal_distribution_that_replaces_poissons_is_symmetric() -> None:
    counts = counted(64.5, Noise(shot=True))
    z = (counts - counts.mean()) / counts.std()
    # A normal sample's skewness has the standard deviation √(6/n), five of which are 0.03. Poisson's skewness is 1/√64.5 = 0.12.
    assert abs((z**3).mean()) < 5 * np.sqrt(6 / counts.size)


def test_counts_saturate_at_the_full_well() -> None:
    noise = Noise(shot=True, full_well_electrons=1000.0)
    counts = counted(1e6, noise, n=1000)
    np.testing.assert_allclose(counts, 1000.0, rtol=1e-6)


def test_nothing_is_counted_below_zero() -> None:
    counts = counted(0.0, Noise(shot=True, read_electrons=50.0), n=1000)
    assert counts.min() == 0.0


@given(st.integers(1, 16))
def test_a_converter_of_n_bits_has_two_to_the_n_levels(bits: int) -> None:
    values = np.linspace(0.0, SATURATED, 200_000, dtype=np.float32)
    output = expose(values, Noise(adc_bits=bits))
    assert len(np.unique(output)) == 2**bits
    step = SATURATED / (2**bits - 1)
    assert np.abs(output - values).max() <= step / 2 * (1 + 1e-3) + 1e-6
    assert (np.diff(output) >= 0).all()


def test_counting_without_noise_and_converter_is_the_identity_below_saturation() -> None:
    values = (np.arange(5000) * 2.0**-10).astype(np.float32)
    noise = Noise(full_well_electrons=8192.0, headroom_ev=3.0)  # powers of two divide exactly
    np.testing.assert_array_equal(expose(values, noise), values)


def test_gain_multiplies_signal_and_noise_and_saturates_earlier() -> None:
    values = np.full(100_000, 0.2, np.float32)
    noise = Noise(shot=True)
    plain = expose(values, noise, generator=np.random.default_rng(0))
    louder = expose(values, noise, gain=4.0, generator=np.random.default_rng(0))
    np.testing.assert_allclose(louder, 4.0 * plain, rtol=1e-5)
    assert expose(np.full(1, 3.0, np.float32), noise, gain=4.0, generator=np.random.default_rng(0))[0] == pytest.approx(
        SATURATED
    )


@given(st.floats(0, 0.05), st.floats(0, 0.05), st.integers(0, 3))
def test_a_higher_rate_keeps_the_faults_of_a_lower_one(dead: float, hot: float, seed: int) -> None:
    values = np.full((80, 90, 3), 0.5, np.float32)

    def broken(d: float, h: float) -> np.ndarray:
        rates = FaultyPixels(dead_rate=d, hot_rate=h)
        return break_pixels(values, rates, SATURATED, np.random.default_rng(seed))[..., 0]

    fewer, more = broken(dead, hot), broken(dead + 0.05, hot + 0.05)
    assert ((fewer == 0.0) <= (more == 0.0)).all()
    assert ((fewer == np.float32(SATURATED)) <= (more == np.float32(SATURATED))).all()


def test_the_rate_of_faults_is_the_share_of_pixels() -> None:
    values = np.full((500, 500, 3), 0.5, np.float32)
    broken = break_pixels(values, FaultyPixels(dead_rate=0.02, hot_rate=0.01), SATURATED, np.random.default_rng(0))
    for rate, faulty in ((0.02, broken[..., 0] == 0.0), (0.01, broken[..., 1] > 1.0)):
        assert abs(faulty.mean() - rate) < 5 * np.sqrt(rate * (1 - rate) / faulty.size)
    np.testing.assert_array_equal(broken[..., 0], broken[..., 2])


def test_no_faults_are_the_identity() -> None:
    values = np.random.default_rng(0).random((20, 30, 3), np.float32)
    np.testing.assert_array_equal(break_pixels(values, FaultyPixels(), SATURATED, np.random.default_rng(0)), values)
