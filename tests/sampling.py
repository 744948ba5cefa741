"""Sizes of samples that comparisons need."""

import math


def enough_to_show(share: float) -> int:
    """Return the size of a sample in which an error in ``share`` of all such places shows with a probability of 95 %."""
    return math.ceil(math.log(0.05) / math.log1p(-share))
