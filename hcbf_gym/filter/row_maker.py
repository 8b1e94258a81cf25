"""The interface between a filter and the objects that make its rows in Python."""

from abc import ABC, abstractmethod

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.relative_degree import ReachedBarriers
from hcbf_gym.barriers.rows import WIDTH, PackedRows
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.samples import Samples, Snapshot


class RowMaker(ABC):
    """Makes the rows of N plants of one model.

    When barriers change, `Scenes` calls `evaluate_previous` with the previous scenes, then `accept`
    with the new ones, and `forget` if these are refused. At a step, `FilterCore` calls `resize` if
    the number of barriers has changed, then `make`. It undoes the step of a reset by `snapshot` and
    `restore`.
    """

    def __init__(self, config: FilterConfig, samples: Samples, bound: Bound):
        self._config, self._samples, self._bound = config, samples, bound
        self._warned_of_kinks: set[str] = set()  # the names of barriers
        self.errors: dict[int, str] = {}  # plant → the error for which its last rows are NaN
        self.resize(0)

    def evaluate_previous(self, scenes: BarrierSet) -> bool:
        """Evaluate the previous scenes at the present states, and return whether that was done."""
        return False

    @abstractmethod
    def accept(self, scenes: BarrierSet) -> ReachedBarriers:
        """Take over changed scenes; return new barriers, and how inputs reach them."""

    @abstractmethod
    def forget(self) -> None:
        """Forget scenes that are refused, so that none of their barriers counts as checked."""

    def resize(self, m: int) -> None:
        """Allocate the rows (N, m, WIDTH + n_u) of scenes of m barriers."""
        width = WIDTH + self._config.input_set.n_u
        self._rows = PackedRows(np.zeros((self._config.count, m, width)))

    @abstractmethod
    def make(self, scenes: BarrierSet, u_nominal: Array) -> Array:
        """Return the rows (N, m, WIDTH + n_u) of accepted scenes at the present samples and u*."""

    def snapshot(self) -> Snapshot:
        """Return a copy of the memory of a step, for `restore`."""
        return self._samples.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Set the memory of a step back to a snapshot."""
        self._samples.restore(snapshot)
