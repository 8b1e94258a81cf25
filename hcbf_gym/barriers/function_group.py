"""Functions of the same signatures in several scenes, whose rows one compiled call returns."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_rows import FunctionRow, RowsKernel
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.many import Flat
from hcbf_gym.barriers.relative_degree import VANISHED
from hcbf_gym.errors import InvalidInputError

_H, _EARLY_INPUTS = FunctionRow.column("h"), FunctionRow.column("early_inputs")


class Instant(NamedTuple):
    """K states, one for each scene of a group, and the margins of its k functions there."""

    x: Array  # (K, n)
    t: Array  # (K,) [s]
    margin: Array  # (K, k) what each row reserves between h and zero
    margin_rate: Array  # (K, k) d margin/dt


class Group(NamedTuple):
    """k functions of the same signatures, at the same places of K scenes."""

    scene_indices: Integers  # (K,) the index of each scene among N
    places: Integers  # (k,) the index of each function among the m barriers of a scene
    kernel: RowsKernel
    functions: tuple[Function, ...]  # k, those of the first scene
    parameters: Array  # (K, p) the parameters of each scene's functions, one behind another

    def rows(self, at: Instant) -> Array:
        """Return the rows (K, k, n_u + 5) of K states, whose columns are those of `FunctionRow`.

        Raises:
            InvalidInputError: if h is not finite, or an input appears below the relative degree.
        """
        shape = len(at.x), len(self.functions), -1
        if len(at.x) == 1:
            inputs = at.x[0], at.t, at.margin[0], at.margin_rate[0], self.parameters[0]
            rows = np.asarray(self.kernel.at_state(np.concatenate(inputs))).reshape(shape)
        else:
            by_column = np.asarray(self.kernel.at_states(*at, self.parameters))  # (k (n_u + 5), K)
            rows = np.ascontiguousarray(by_column.T).reshape(shape)
        early_inputs = rows[..., _EARLY_INPUTS]
        if not early_inputs.max() <= VANISHED:  # or NaN, where h is not finite
            self._refuse(rows[..., _H], early_inputs)
        return rows

    def rows_beside_kinks(
        self, at: Instant, rows: Array, kinks: Kinks, barriers_by_scene: Sequence[Flat]
    ) -> Array:
        """Return rows (K, k, n_u + 5) with those that are not finite taken beside their states.

        Warnings name the barriers, which `barriers_by_scene` has for all N scenes.
        """
        rows = rows.copy()
        for j, k in np.argwhere(~np.isfinite(rows).all(axis=2)):
            scene = int(self.scene_indices[j])
            for state_beside in kinks.states_beside(self.kernel.model, at.x[j], scene):
                x = at.x.copy()
                x[j] = state_beside
                row = self.rows(at._replace(x=x))[j, k]
                if np.isfinite(row).all():
                    barrier: Any = barriers_by_scene[scene][self.places[k]]
                    kinks.warn_once(barrier, at.x[j])
                    h = rows[j, k, _H]
                    rows[j, k] = row
                    rows[j, k, _H] = h
                    break
        return rows

    def _refuse(self, h: Array, early_inputs: Array) -> None:
        """Raise the error of the first function that is wrong, by these columns (K, k)."""
        for k, function in enumerate(self.functions):
            if not np.isfinite(h[..., k]).all():
                raise InvalidInputError(f"{function.name}: got h = {h[..., k]}, expected finite h")
            if (early_inputs[..., k] > VANISHED).any():
                raise InvalidInputError(
                    f"{function.name}: got an input in a derivative below the relative degree "
                    f"{self.kernel.reaches[k].degree} of all sampled states, expected one degree "
                    "everywhere"
                )
