"""Median times of calls that take turns in blocks, so that all see the same machine."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Timed = tuple[Callable[[], Any], Callable[[], Any]]
"""What prepares a call, and the call that is timed."""
WARM, BLOCK = 5, 25
"""Calls of a block, the first of which are not timed: caches and XLA's threads are warm by then."""


def blocks_in_turn(calls: Sequence[Timed], blocks: int) -> NDArray[np.float64]:
    """Return each call's median time [µs] within blocks of it alone; the blocks take turns."""
    times = np.empty((blocks, BLOCK, len(calls)))
    for i in range(blocks):
        for k, (prepare, call) in enumerate(calls):
            prepare()
            for j in range(BLOCK):
                start = time.perf_counter()
                call()
                times[i, j, k] = time.perf_counter() - start
    return 1e6 * np.median(times[:, WARM:], axis=(0, 1))
