"""Type and shape of a confusion matrix, which `valerie.metrics.confusion` computes."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import NUM_TRAIN_CLASSES

#: Rows are true classes 0…18; columns are predicted classes 0…18, then predicted void.
SHAPE: Final = (NUM_TRAIN_CLASSES, NUM_TRAIN_CLASSES + 1)

ConfusionMatrix = NDArray[np.int64]
