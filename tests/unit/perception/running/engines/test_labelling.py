import numpy as np
import torch
from torch import Tensor, nn

from valerie.perception.running.engines.labelling import label_maps, largest_channel, normalised

MEAN, STD = torch.tensor([0.5, 0.5, 0.5]), torch.tensor([0.25, 0.5, 1.0])


class BrightnessNetwork(nn.Module):
    """Class 11 where the red mean of a 4 × 4 cell is above middle grey, else class 0; remembers its input."""

    def forward(self, x: Tensor) -> Tensor:
        self.seen = x
        red = nn.functional.avg_pool2d(x[:, :1], 4)
        logits = torch.zeros(x.shape[0], 19, *red.shape[-2:])
        logits[:, 11:12] = red
        return logits


def test_normalisation_follows_the_formula() -> None:
    pictures = torch.tensor([0, 51, 255], dtype=torch.uint8).view(1, 1, 1, 3)
    values = normalised(pictures, MEAN, STD).flatten().tolist()
    np.testing.assert_allclose(values, [(0 - 0.5) / 0.25, (0.2 - 0.5) / 0.5, (1 - 0.5) / 1], rtol=1e-6)


def test_padding_repeats_the_last_row_and_column_and_is_cut_off_exactly() -> None:
    picture = np.zeros((1, 50, 70, 3), np.uint8)
    picture[:, 20:, 40:] = 255
    network = BrightnessNetwork()
    labels = label_maps(network, torch.from_numpy(picture), MEAN, STD)
    assert labels.shape == (1, 50, 70)
    assert network.seen.shape[-2:] == (64, 96)
    assert torch.equal(network.seen[..., 50:, :], network.seen[..., 49:50, :].expand(-1, -1, 14, -1))
    assert torch.equal(network.seen[..., 70:], network.seen[..., 69:70].expand(-1, -1, -1, 26))


def test_labels_lie_on_the_pixels_that_caused_them() -> None:
    picture = np.zeros((1, 64, 64, 3), np.uint8)
    picture[:, 16:32, 8:40] = 255
    labels = label_maps(BrightnessNetwork(), torch.from_numpy(picture), MEAN, STD)[0].numpy()
    inside = np.zeros((64, 64), bool)
    inside[16:32, 8:40] = True
    # Bilinear resampling rounds the corners of the 1/4-resolution mask, one pixel each.
    wrong = {(int(row), int(column)) for row, column in np.argwhere((labels == 11) != inside)}
    assert wrong <= {(16, 8), (16, 39), (31, 8), (31, 39)}


def test_of_equal_logits_the_smaller_train_id_wins() -> None:
    grey = torch.full((1, 32, 32, 3), 0, dtype=torch.uint8)
    network = nn.AdaptiveAvgPool2d(8)

    class Equal(nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            return network(x[:, :1]).expand(-1, 19, -1, -1)

    assert label_maps(Equal(), grey, MEAN, STD).max() == 0


def test_many_channels_in_parts_give_the_result_of_the_whole() -> None:
    logits = torch.randint(0, 40, (2, 150, 6, 9)).float()  # many are equal
    whole = nn.functional.interpolate(logits, size=(24, 36), mode="bilinear", align_corners=False).argmax(dim=1)
    assert torch.equal(largest_channel(logits, 24, 36), whole.to(torch.uint8))
