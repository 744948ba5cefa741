"""Make weights and a picture that follow from a name and a shape, so that no weights need to be kept.

The references of ``tests/unit/perception/fixtures/checkpoints`` are the logits that the origins' code computes from them. The
tests give VALERIE's networks the same weights and picture. Nothing here is specific to a network.
"""

import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Folder of the references.
KEPT: Final = Path(__file__).parents[2] / "tests" / "unit" / "perception" / "fixtures" / "checkpoints"


def uniform(name: str, shape: Sequence[int]) -> NDArray[np.float32]:
    """Return multiples of 1/65536 in [0, 1): the quarters of 64-bit words of PCG64, lowest first.

    PCG64 is seeded with the first 8 bytes of the name's SHA-256.
    """
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    count = math.prod(shape)
    words = np.asarray(np.random.PCG64(seed).random_raw(-(-count // 4)), "<u8")
    return (words.view("<u2")[:count] * np.float32(2.0**-16)).reshape(shape)


def tensor(name: str, shape: Sequence[int]) -> NDArray[np.float32]:
    """Return a tensor that keeps activations near 1: He's variance for kernels, small scales at the end of a residual block."""
    u = uniform(name, shape)
    if len(shape) > 1:
        value = (2.0 * u - 1.0) * math.sqrt(6.0 / math.prod(shape[1:]))
    elif name.endswith("running_var"):
        value = 0.5 + u
    elif name.endswith("weight"):
        value = 0.05 + 0.1 * u if "bn3" in name or "conv3.norm" in name else 0.8 + 0.3 * u
    else:
        value = 0.2 * u - 0.1
    return np.asarray(value, np.float32)


def picture() -> NDArray[np.float32]:
    """Return a normalised picture, (1, 3, 64, 96), values in [−2, 2)."""
    return np.asarray(4.0 * uniform("picture", (1, 3, 64, 96)) - 2.0, np.float32)


def sampled(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the logits that are kept, (C, 4, 6), of all, (1, C, 64, 96)."""
    return logits[0, :, 3::16, 5::16]


def digest(shapes: Mapping[str, Sequence[int]]) -> str:
    """Return the SHA-256 of a list of tensors: a line ``name 64x3x7x7`` for each, sorted by name."""
    lines = (f"{name} {'x'.join(map(str, shape))}\n" for name, shape in sorted(shapes.items()))
    return hashlib.sha256("".join(lines).encode()).hexdigest()
