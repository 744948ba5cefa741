"""Functions that are told how far a long piece of work is."""

from __future__ import annotations

from collections.abc import Callable

#: Is told how many are done, and of how many.
Count = Callable[[int, int], object]
#: Is told this, how many are done per second, and in words what is done.
Pace = Callable[[int, int, float, str], object]
