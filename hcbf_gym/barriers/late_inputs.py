r"""Finds inputs that enter a later derivative of h than those in its row.

The row of a barrier holds the inputs that enter the first derivative of h that any input enters. An
input that enters a later derivative is left to the policy, which may use it against the row. An
example is a car whose row steers it around a disc, while the gas pedal drives it into the disc.

Links between states and inputs are found at sampled states. The state derivative ẋ_i depends on x_k
if f_i or a g_ij changes with x_k. Input j drives x_i if g_ij is not 0. The number of links from an
input to a state that h reads is the derivative that the input enters first, unless terms cancel.
"""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.arrays import Integers, Mask
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.relative_degree import Reach, samples
from hcbf_gym.models.reduced_order import ReducedOrderModel

_CHANGE = 0.1  # the change of a state that probes f and g, relative to 1 + |x|
_ROUNDING = 1e-9  # a smaller change of f or g, relative to their size, is rounding

REMEDY = (
    "expected a condition that these inputs enter as early: one that reads a point ahead, or the "
    "distance left after braking; a model whose early input is made a state (dynamic extension); "
    "or allow_late_inputs=True, where the policy never uses them against the row"
)


class LateInputs:
    """Finds the barriers of a model whose rows miss an input.

    Attributes:
        states: (n, n) entry (i, k) is true if ẋ_i depends on x_k.
        inputs: (n, n_u) entry (i, j) is true if input j drives x_i.
    """

    def __init__(self, model: ReducedOrderModel) -> None:
        self._model, n = model, model.n
        self.states: Mask = np.zeros((n, n), dtype=np.bool_)
        self.inputs: Mask = np.zeros((n, model.n_u), dtype=np.bool_)
        for x in samples(model)[0]:
            f, g = model.f(x), model.g(x)
            rounding = _ROUNDING * (1.0 + np.abs(f).max() + np.abs(g).max())
            self.inputs |= np.abs(g) > rounding
            for k in range(n):
                moved = x.copy()
                moved[k] += _CHANGE * (1.0 + abs(x[k]))
                self.states[:, k] |= np.abs(model.f(moved) - f) > rounding
                self.states[:, k] |= (np.abs(model.g(moved) - g) > rounding).any(axis=1)
        self._is_late: dict[bytes, bool] = {}  # by `reads` and `inputs` of a reach

    def degrees(self, reads: Mask) -> Integers:
        """Return (n_u,) the first derivative of h that each input enters; 0 if it enters none.

        `reads` (n,) is true for the states on which h depends.
        """
        degrees = np.zeros(self.inputs.shape[1], dtype=np.int64)
        for degree in range(1, reads.size + 1):
            degrees[(degrees == 0) & self.inputs[reads].any(axis=0)] = degree
            reads = reads | self.states[reads].any(axis=0)
        return degrees

    def find(self, barriers: Sequence[Barrier], reaches: Sequence[Reach]) -> list[str]:
        """Return a sentence for each of m barriers whose row misses an input, by the m reaches."""
        messages = []
        for barrier, reach in zip(barriers, reaches, strict=True):
            key = reach.reads.tobytes() + reach.inputs.tobytes()
            if self._is_late.get(key) is False:
                continue
            degrees = self.degrees(reach.reads)
            late = np.flatnonzero((degrees > 0) & ~reach.inputs)
            self._is_late[key] = bool(late.size)
            if late.size:
                messages.append(self._message(barrier, reach, late, degrees))
        return messages

    def _message(self, barrier: Barrier, reach: Reach, late: Integers, degrees: Integers) -> str:
        early = ", ".join(f"u[{j}]" for j in np.flatnonzero(reach.inputs))
        later = ", ".join(f"u[{j}] by derivative {max(degrees[j], reach.degree + 1)}" for j in late)
        return (
            f"{barrier.name}: its row holds only {early}, which enters derivative {reach.degree} "
            f"of h, and leaves other inputs of {self._model} that move h to the policy: {later}"
        )
