from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import torch

from valerie.errors import InvalidInput, UnknownName
from valerie.labels import PERSON
from valerie.perception.importing.function_file import function_file_bytes
from valerie.perception.importing.network_weights import load_network
from valerie.perception.shipped import function_card, load_function
from valerie.perception.training import fit
from valerie.perception.training.fit import TrainingProgress, train
from valerie.perception.training.frame_folder import TrainingFrame
from valerie.perception.training.loss import pixel_loss
from valerie.perception.training.samples import batches
from valerie.perception.training.training_settings import TrainingSettings

CROPS = {"height": 32, "width": 64, "scales": (1.0,), "scale_jitter": 1.0, "noise": 2.0}


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def settings(**changes) -> TrainingSettings:
    recipe = {"architecture": "semantic-fpn-small", "steps": 6, "batch": 2, "precision": "fp32", "device": "cpu"}
    recipe |= {"warmup_steps": 2, "crops": CROPS, "loader_threads": 2}
    return TrainingSettings.model_validate(recipe | changes)


def same_weights(one: torch.nn.Module, other: torch.nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


class _InterruptedError(Exception):
    pass


def blind_loss(chosen: TrainingSettings, frames: Sequence[TrainingFrame], *, last: int) -> float:
    """The smallest mean loss over the last batches of a network that does not look at the pictures."""
    weights = torch.ones(19)
    weights[PERSON.train_id] = chosen.person_weight
    labels = torch.from_numpy(np.concatenate([labels for _, labels in batches(frames, chosen, chosen.steps - last)]))
    shares = weights * torch.bincount(labels[labels < 19].long(), minlength=19)
    logits = (shares / shares.sum()).clamp(min=1e-12).log().view(1, 19, 1, 1).expand(len(labels), 19, *labels.shape[1:])
    return float(pixel_loss(logits, labels.long(), weights))


@pytest.mark.parametrize("architecture", ["deeplabv3plus-small", "semantic-fpn-small"])
def test_a_network_learns_a_few_frames(architecture: str, make_frames) -> None:
    losses: list[float] = []
    chosen, frames = settings(architecture=architecture, steps=30, batch=4), make_frames(4)
    model = train(
        chosen,
        frames,
        held_out=make_frames(2, site_seed=900),
        progress=lambda p: losses.append(p.loss),
    )
    assert len(losses) == model.steps == 30
    assert sum(losses[-5:]) / 5 < 0.5 * blind_loss(chosen, frames, last=5)
    assert model.figures is not None
    assert model.figures.frames == 2


def test_equal_seeds_give_equal_weights_bit_for_bit(make_frames) -> None:
    models = [train(settings(loader_threads=n), make_frames(3)) for n in (1, 3)]
    assert same_weights(models[0].network, models[1].network)
    assert models[0].to_bytes({}) == models[1].to_bytes({})


def test_another_seed_gives_other_weights(make_frames) -> None:
    models = [train(settings(seed=seed, steps=1), make_frames(3)) for seed in (0, 1)]
    assert not same_weights(models[0].network, models[1].network)


def test_an_interrupted_run_resumes_to_the_same_weights(make_frames, tmp_path: Path) -> None:
    frames = make_frames(3)
    whole = train(settings(), frames)
    checkpoint = tmp_path / "run.ckpt"

    def stop_after_four(progress: TrainingProgress) -> None:
        if progress.step == 4:
            raise _InterruptedError

    with pytest.raises(_InterruptedError):
        train(settings(checkpoint_every=3), frames, progress=stop_after_four, checkpoint=checkpoint)
    steps: list[int] = []
    resumed = train(
        settings(checkpoint_every=3), frames, progress=lambda p: steps.append(p.step), checkpoint=checkpoint
    )
    assert steps == [4, 5, 6]
    assert same_weights(resumed.network, whole.network)
    assert resumed.final_loss == whole.final_loss


def test_a_finished_run_is_not_trained_again(make_frames, tmp_path: Path) -> None:
    first = train(settings(), make_frames(3), checkpoint=tmp_path / "c")
    steps: list[int] = []
    again = train(settings(), make_frames(3), checkpoint=tmp_path / "c", progress=lambda p: steps.append(p.step))
    assert steps == []
    assert same_weights(first.network, again.network)


def test_a_checkpoint_of_another_run_is_refused(make_frames, tmp_path: Path) -> None:
    train(settings(steps=1), make_frames(3), checkpoint=tmp_path / "c")
    with pytest.raises(InvalidInput, match="another run"):
        train(settings(steps=1, seed=1), make_frames(3), checkpoint=tmp_path / "c")


@pytest.mark.parametrize("data", [b"", b"nothing", b"\x80\x04\x95junk"])
def test_a_file_that_is_not_a_checkpoint_is_refused(make_frames, tmp_path: Path, data: bytes) -> None:
    (tmp_path / "c").write_bytes(data)
    with pytest.raises(InvalidInput, match="not a checkpoint"):
        train(settings(), make_frames(3), checkpoint=tmp_path / "c")


def test_a_time_budget_ends_the_schedule(make_frames) -> None:
    model = train(settings(steps=1_000_000, time_budget_s=1e-6), make_frames(3))
    assert model.steps < 5


def test_half_precision_on_the_way_trains_too(make_frames) -> None:
    losses: list[float] = []
    train(settings(precision="bf16", steps=12), make_frames(2), progress=lambda p: losses.append(p.loss))
    assert sum(losses[-3:]) < sum(losses[:3])


@pytest.mark.parametrize(("multiplies", "precision"), [(True, "bf16"), (False, "fp32")])
def test_bf16_is_chosen_on_processors_that_multiply_it(
    make_frames, monkeypatch: pytest.MonkeyPatch, multiplies: bool, precision: str
) -> None:
    monkeypatch.setattr(fit, "multiplies_bf16", lambda: multiplies)
    assert train(settings(precision="auto", steps=1), make_frames(2)).settings.precision == precision


def test_figures_are_reported_on_the_way_when_asked(make_frames) -> None:
    reports: list[TrainingProgress] = []
    held_out = make_frames(1, site_seed=900)
    train(settings(validate_every=2), make_frames(3), held_out=held_out, progress=reports.append)
    assert [report.step for report in reports if report.figures is not None] == [2, 4]


def test_the_written_function_is_found_and_predicts_as_the_model(make_frames, tmp_path: Path) -> None:
    frames = make_frames(3)
    model = train(settings(steps=20), frames, held_out=make_frames(2, site_seed=900))
    path = tmp_path / "semantic-fpn-small.safetensors"
    path.write_bytes(model.to_bytes({"licence": "Apache-2.0"}))
    card = function_card("semantic-fpn-small", folder=tmp_path)
    assert card.provenance["licence"] == "Apache-2.0"
    assert card.provenance["steps"] == "20"
    assert card.provenance["held-out-frames"] == "2"
    function = load_function("semantic-fpn-small", folder=tmp_path, precision="fp32")
    from valerie.perception.running.engines.labelling import label_maps

    with torch.inference_mode():
        expected = label_maps(
            model.network,
            torch.from_numpy(frames[0].picture).unsqueeze(0),
            torch.tensor(model.mean),
            torch.tensor(model.std),
        )[0]
    assert (function.predict(frames[0].picture) == expected.numpy()).all()


def test_running_variances_beyond_half_precision_are_kept(make_frames, tmp_path: Path) -> None:
    path = tmp_path / "before.safetensors"
    path.write_bytes(train(settings(steps=1), make_frames(2)).to_bytes({}))
    network, header = load_network(path)
    tensors = {name: value.numpy() for name, value in network.state_dict().items() if value.is_floating_point()}
    name = next(name for name in tensors if name.endswith("running_var"))
    tensors[name] = tensors[name] + 1e5
    header_fields = {"architecture": header.architecture, "mean": header.mean, "std": header.std, "provenance": {}}
    path.write_bytes(function_file_bytes(tensors, **header_fields))
    model = train(settings(steps=1, keep_norm_statistics=True), make_frames(2), start_from=path)
    path.write_bytes(model.to_bytes({}))
    assert same_weights(load_network(path)[0], model.network)
    assert model.network.state_dict()[name].min() >= 1e5


def test_the_figures_of_a_function_that_reduces_frames_are_those_of_its_own_labels(make_frames, tmp_path: Path) -> None:
    held_out = make_frames(3, site_seed=900)
    model = train(settings(steps=20, batch=4, longest_side=64), make_frames(4), held_out=held_out)
    (tmp_path / "semantic-fpn-small.safetensors").write_bytes(model.to_bytes({}))
    function = load_function("semantic-fpn-small", folder=tmp_path, device="cpu")
    hits = persons = 0
    for frame in held_out:
        mask = frame.train_ids == 11
        hits += int((function.predict(frame.picture)[mask] == 11).sum())
        persons += int(mask.sum())
    function.close()
    assert model.figures is not None
    assert 0 < hits < persons
    # The figures come from torch, the labels from the engine that is fastest here: pixels on an edge may differ.
    assert model.figures.person_pacc == pytest.approx(hits / persons, abs=3 / persons)


def test_a_site_in_both_sets_is_refused(make_frames) -> None:
    with pytest.raises(InvalidInput, match="1000"):
        train(settings(), make_frames(2), held_out=make_frames(1))


def test_no_frames_are_refused() -> None:
    with pytest.raises(InvalidInput, match="no frames"):
        train(settings(), [])


def test_an_unknown_architecture_is_refused(make_frames) -> None:
    with pytest.raises(UnknownName, match="semantic-fpn-small"):
        train(settings(architecture="semantic-fpn-smal"), make_frames(1))


def test_a_batch_that_is_void_throughout_leaves_finite_weights(make_frames) -> None:
    void = [TrainingFrame(f.picture, f.train_ids * 0 + 255, f.site_seed) for f in make_frames(2)]
    model = train(settings(steps=2), void)
    assert all(torch.isfinite(p).all() for p in model.network.parameters())


def test_training_does_not_move_the_random_generator_of_the_caller(make_frames) -> None:
    torch.manual_seed(9)
    expected = torch.rand(2)
    torch.manual_seed(9)
    train(settings(steps=1), make_frames(1))
    assert torch.equal(torch.rand(2), expected)


def test_training_starts_from_the_weights_and_normalisation_of_a_function_file(make_frames, tmp_path: Path) -> None:
    first = train(settings(steps=3), make_frames(2))
    path = tmp_path / "first.safetensors"
    path.write_bytes(first.to_bytes({}))
    # With a learning rate of almost nothing the weights stay what they were.
    second = train(settings(steps=1, learning_rate=1e-12, warmup_steps=0), make_frames(3), start_from=path)
    assert (second.mean, second.std) == (first.mean, first.std)
    parameters = zip(second.network.parameters(), first.network.parameters(), strict=True)
    assert all(torch.allclose(one, other, atol=1e-6) for one, other in parameters)


def test_batch_normalisation_keeps_its_statistics_on_request(make_frames, tmp_path: Path) -> None:
    path = tmp_path / "before.safetensors"
    path.write_bytes(train(settings(), make_frames(3)).to_bytes({}))
    before, _ = load_network(path)

    def trained(**changes: object) -> dict[str, torch.Tensor]:
        # validated on the way, which goes through evaluation mode and back
        held_out = make_frames(1, site_seed=900)
        model = train(settings(validate_every=2, **changes), make_frames(3), held_out=held_out, start_from=path)
        return model.network.state_dict()

    kept, moved = trained(keep_norm_statistics=True), trained()
    for name, value in before.state_dict().items():
        is_statistic = name.endswith(("running_mean", "running_var"))
        assert torch.equal(kept[name], value) == is_statistic or name.endswith("num_batches_tracked"), name
        assert not (is_statistic and torch.equal(moved[name], value)), name


def test_training_does_not_start_from_another_architecture(make_frames, tmp_path: Path) -> None:
    path = tmp_path / "first.safetensors"
    path.write_bytes(train(settings(steps=1), make_frames(2)).to_bytes({}))
    other = "semantic-fpn-small" if settings().architecture != "semantic-fpn-small" else "deeplabv3plus-small"
    with pytest.raises(InvalidInput, match="another architecture"):
        train(settings(steps=1, architecture=other), make_frames(2), start_from=path)
