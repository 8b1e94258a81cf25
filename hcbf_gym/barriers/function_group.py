"""Functions of the same signatures in several scenes, whose rows one compiled call returns."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_rows import EARLY, H, RowsKernel
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.many import Flat
from hcbf_gym.barriers.relative_degree import VANISHED
from hcbf_gym.errors import InvalidInputError


class Instant(NamedTuple):
    """K states, one for each scene of a group, and the margins of its k functions there."""

    x: Array  # (K, n)
    t: Array  # (K,) [s]
    margin: Array  # (K, k) what each row reserves between h and zero
    margin_rate: Array  # (K, k) d margin/dt


class Group(NamedTuple):
    """k functions of the same signatures, at the same places of K scenes."""

    scenes: Integers  # (K,) which of N
    places: Integers  # (k,) which of m
    kernel: RowsKernel
    functions: tuple[Function, ...]  # k, those of the first scene
    parameters: Array  # (K, p) of each scene's functions, one behind another

    def rows(self, at: Instant) -> Array:
        """Return the rows (K, k, n_u + 5) of K states, whose columns `function_rows` names.

        Raises:
            InvalidInputError: if h is not finite, or an input appears below the relative degree.
        """
        shape = len(at.x), len(self.functions), self.kernel.model.n_u + 5
        if len(at.x) == 1:
            first = at.x[0], at.t, at.margin[0], at.margin_rate[0], self.parameters[0]
            out = np.asarray(self.kernel.one(np.concatenate(first))).reshape(shape)
        else:
            made = np.asarray(self.kernel.many(*at, self.parameters))
            out = np.ascontiguousarray(np.moveaxis(made, -1, 0)).reshape(shape)
        early = out[..., EARLY]
        if not early.max() <= VANISHED:
            self._refuse(out[..., H], early)
        return out

    def rows_beside(self, at: Instant, rows: Array, kinks: Kinks, scenes: Sequence[Flat]) -> Array:
        """Return rows (K, k, n_u + 5) with those that are not finite taken beside their states.

        `scenes` has the barriers of all N, whose names are in warnings.
        """
        rows = rows.copy()
        for j, k in np.argwhere(~np.isfinite(rows).all(axis=2)):
            i = int(self.scenes[j])
            for beside in kinks.states_beside(self.kernel.model, at.x[j], i):
                moved = at.x.copy()
                moved[j] = beside
                row = self.rows(at._replace(x=moved))[j, k]
                if np.isfinite(row).all():
                    barrier: Any = scenes[i][self.places[k]]
                    kinks.warn_once(barrier, at.x[j])
                    h = rows[j, k, H]
                    rows[j, k] = row
                    rows[j, k, H] = h
                    break
        return rows

    def _refuse(self, h: Array, early: Array) -> None:
        """Raise the error of the function that is wrong."""
        for k, function in enumerate(self.functions):
            if not np.isfinite(h[..., k]).all():
                raise InvalidInputError(f"{function.name}: got h = {h[..., k]}, expected finite h")
            if (early[..., k] > VANISHED).any():
                raise InvalidInputError(
                    f"{function.name}: got an input in a derivative below the relative degree "
                    f"{self.kernel.reaches[k].degree} of all sampled states, expected one degree "
                    "everywhere"
                )
