import numpy as np
import pytest

from valerie.perception.training.frame_folder import TrainingFrame
from valerie.perception.training.samples import batches, cut, recolour
from valerie.perception.training.training_settings import CropSettings, TrainingSettings

PLAIN = {"scale_jitter": 1.0, "exposure_stops": 0.0, "contrast": 0.0, "saturation": 0.0, "white_balance": 0.0}
PLAIN |= {"noise": 0.0, "blur_share": 0.0, "flip_share": 0.0}


def crop(**changes) -> CropSettings:
    return CropSettings.model_validate({"height": 32, "width": 64, **PLAIN, **changes})


def coordinate_frame(height: int = 100, width: int = 200) -> TrainingFrame:
    """Red is the row, green the column; the label is 0 in the left half and 1 in the right."""
    rows, columns = np.mgrid[0:height, 0:width].astype(np.uint8)
    labels = (columns >= width // 2).astype(np.uint8)
    return TrainingFrame(np.stack([rows, columns, np.zeros_like(rows)], axis=2), labels, 0)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_at_scale_one_a_sample_is_a_window_of_the_frame() -> None:
    frame = coordinate_frame()
    picture, labels = cut(frame, crop(scales=(1.0,)), rng(1))
    top, left = int(picture[0, 0, 0]), int(picture[0, 0, 1])
    np.testing.assert_array_equal(picture, frame.picture[top : top + 32, left : left + 64])
    np.testing.assert_array_equal(labels, frame.train_ids[top : top + 32, left : left + 64])


def test_at_half_scale_a_sample_shows_twice_the_extent() -> None:
    picture, _ = cut(coordinate_frame(), crop(scales=(0.5,)), rng(2))
    steps = np.diff(picture[..., 1].astype(int), axis=1)
    assert set(np.unique(steps)) <= {1, 2, 3}
    assert abs(steps.mean() - 2.0) <= 1 / len(steps[0])  # each end is rounded by up to a half


def test_scales_refer_to_the_frame_that_the_function_sees() -> None:
    frame, one = coordinate_frame(), crop(scales=(1.0,))
    halved, _ = cut(frame, one, rng(2), longest_side=100)
    steps = np.diff(halved[..., 1].astype(int), axis=1)
    assert abs(steps.mean() - 2.0) <= 1 / len(steps[0])  # each end is rounded by up to a half
    whole, _ = cut(frame, one, rng(2), longest_side=400)
    np.testing.assert_array_equal(whole, cut(frame, one, rng(2))[0])


@pytest.mark.parametrize("seed", range(8))
def test_labels_stay_on_their_pixels_through_scale_and_mirror(seed: int) -> None:
    picture, labels = cut(coordinate_frame(), crop(scales=(1.0, 0.7, 0.5), flip_share=0.5, person_share=0.0), rng(seed))
    shown = picture[..., 1].astype(int)
    valid = labels != 255
    certain = valid & (abs(shown - 99.5) > 2)
    np.testing.assert_array_equal(labels[certain], (shown[certain] >= 100).astype(np.uint8))


def test_mirroring_reverses_columns() -> None:
    picture, _ = cut(coordinate_frame(), crop(scales=(1.0,), flip_share=1.0), rng(3))
    assert (np.diff(picture[..., 1].astype(int), axis=1) == -1).all()


def test_a_frame_smaller_than_the_window_is_padded_with_void() -> None:
    frame = coordinate_frame(20, 30)
    picture, labels = cut(frame, crop(scales=(1.0,)), rng(4))
    np.testing.assert_array_equal(labels[:20, :30], frame.train_ids)
    assert (labels[20:] == 255).all()
    assert (labels[:, 30:] == 255).all()
    assert picture[20:].max() == 0


def test_a_sample_holds_a_person_on_request() -> None:
    frame = coordinate_frame()
    labels = frame.train_ids.copy()
    labels[50, 150] = 11
    with_person = TrainingFrame(frame.picture, labels, 0)
    settings = crop(scales=(1.0,), person_share=1.0)
    assert all((cut(with_person, settings, rng(seed))[1] == 11).sum() == 1 for seed in range(20))


def test_a_frame_without_persons_is_cut_anywhere() -> None:
    corners = {cut(coordinate_frame(), crop(scales=(1.0,), person_share=1.0), rng(s))[0][0, 0, 1] for s in range(20)}
    assert len(corners) > 10  # of 137 columns, 20 draws hit fewer than eleven once in 10^10 trials


def test_recolouring_without_disturbance_changes_nothing() -> None:
    picture = rng(5).integers(0, 256, (16, 16, 3)).astype(np.uint8)
    np.testing.assert_array_equal(recolour(picture, crop(), rng(6)), picture)


def test_recolouring_brightens_or_darkens_by_the_given_stops_at_most() -> None:
    grey = np.full((8, 8, 3), 100, np.uint8)
    shown = [int(recolour(grey, crop(exposure_stops=1.0), rng(seed))[0, 0, 0]) for seed in range(50)]
    low, high = 100 * 2 ** (-1 / 2.2), 100 * 2 ** (1 / 2.2)
    # Half a stop and more in each direction: 50 draws of at most one stop all miss it once in 10^6 trials.
    assert low - 1 <= min(shown) < 100 * 2 ** (-0.5 / 2.2)
    assert 100 * 2 ** (0.5 / 2.2) < max(shown) <= high + 1


def settings(**changes) -> TrainingSettings:
    recipe = {"architecture": "semantic-fpn-small", "steps": 3, "batch": 2, "crops": crop()}
    return TrainingSettings.model_validate(recipe | changes)


def test_batches_do_not_depend_on_threads(make_frames) -> None:
    frames = make_frames(5)
    one, many = (list(batches(frames, settings(loader_threads=n), 0)) for n in (1, 4))
    for (a, b), (c, d) in zip(one, many, strict=True):
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(b, d)


def test_a_later_start_gives_the_same_batches(make_frames) -> None:
    frames = make_frames(5)
    whole = list(batches(frames, settings(), 0))
    rest = list(batches(frames, settings(), 2))
    assert len(whole) == 3
    assert len(rest) == 1
    np.testing.assert_array_equal(rest[0][0], whole[2][0])


def test_another_seed_gives_other_batches(make_frames) -> None:
    frames = make_frames(5)
    one, other = (next(batches(frames, settings(seed=seed), 0))[0] for seed in (0, 1))
    assert not np.array_equal(one, other)


def test_every_frame_is_taken_once_per_pass() -> None:
    frames = [TrainingFrame(np.full((32, 64, 3), n, np.uint8), np.zeros((32, 64), np.uint8), 0) for n in range(6)]
    samples = [
        int(picture[0, 0, 0])
        for pictures, _ in batches(frames, settings(crops=crop(scales=(1.0,))), 0)
        for picture in pictures
    ]
    assert sorted(samples) == [0, 1, 2, 3, 4, 5]
