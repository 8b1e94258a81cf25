"""The compiled filter of N plants, bound to the arrays that it reads and to its report.

The report, ``info["safety_filter"]``, has the fields of `report` in `plants.hpp`. The keys are the
same for every filter; a field that a filter does not write is 0.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info, Records, numbers_of, record_type
from hcbf_gym.barriers.rows import WIDTH
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.filter import solvers
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.samples import Samples

NO_ROWS: Array = np.zeros((0, 0, WIDTH + 2))
"""The rows that Python makes, if it makes none."""


@cache
def plant_dtype(n_u: int) -> np.dtype[np.void]:
    """Return the type of the report of a plant of n_u inputs; u* and u are behind the struct."""
    return record_type("report.Plant", u_nominal=n_u, u_safe=n_u)


ROW = record_type("report.Row")
"""The type of the report of a row; rows are in the order of the barriers."""

_ROWS = ROW.names or ()
_PLANTS = plant_dtype(2).names or ()
_SCALARS = _PLANTS[:-2]
_WORD = 8  # bytes of a number or a code
_ROW_WORDS = ROW.itemsize // _WORD


class SceneArrays(NamedTuple):
    """The arrays to which the compiled filter is bound; None before the first step."""

    kind: Any = None  # the first six are arrays of a `BarrierSet`
    parameters: Any = None
    priority: Any = None
    own_margin: Any = None
    atlas: Any = None
    ends: Any = None
    rows: Any = None  # (N, m, WIDTH + n_u) the rows that Python makes


class Bound:
    """Filters N plants in compiled code, which is bound anew to arrays that are replaced.

    `batch` is N of a batch, or None for one plant, whose report has no leading N.

    Attributes:
        core: the compiled filter.
        plants: (N,) the reports of the plants.
        rows: (N, M) the reports of the rows, `ROW`; M is m, and one more with guidance.
        u_nominal: (N, n_u) u*, a view of `plants`.
        words: (N, …) the numbers of which `plants` and `rows` consist.
    """

    def __init__(self, config: FilterConfig, samples: Samples, batch: int | None, threads: int):
        self._config, self._samples, self._threads = config, samples, threads
        self._alone, self._count = batch is None, config.count
        self._dtype = plant_dtype(config.input_set.n_u)
        self.plants: Records = np.zeros(self._count, dtype=self._dtype)
        self.plants["alpha1_scale"] = config.alpha1_scale
        self._make_core()
        self.resize(0, 0)

    def _make_core(self) -> None:
        """Make the compiled filter, which is not bound to a scene yet."""
        config, samples = self._config, self._samples
        self.core = _core.Filter(config.words, config.program, samples.words, self._threads)
        if samples.is_apart:
            self.core.set_states(*samples.states)
        if config.gate is not None:
            self.core.set_laws(config.gate.input)
        self._scene = SceneArrays()

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a copy, which binds its own arrays."""
        parts = "core", "plants", "rows", "u_nominal", "_head"
        return {name: value for name, value in vars(self).items() if name not in parts}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        scene = self._scene
        self._make_core()
        self._divide(self._numbers)
        if scene.kind is not None:  # `copy_of_last_step` needs the scene of the last step
            self._scene = scene
            self.core.set_scene(*scene)

    def resize(self, m: int, total: int) -> None:
        """Allocate the reports of `total` rows, the first m of which the user gets."""
        before, self._m, self._total = self.plants, m, total
        words = self._dtype.itemsize // _WORD + total * _ROW_WORDS
        self._divide(np.zeros(self._count * words))
        self.plants[...] = before
        if self._alone:
            self._places = _places(self._dtype, m)
            self._reported, self._scalars = b"", {}

    def renew(self) -> None:
        """Allocate the next report, as the user has the last one; a step writes all rows."""
        before, _ = self.words
        self._divide(np.empty_like(self._numbers))
        self.words[0][...] = before
        self.plants["alpha1_scale"] = (
            self._config.alpha1_scale
        )  # the user may have written to the last

    def _divide(self, memory: Array) -> None:
        """Let both reports be views of one array, which is copied at once."""
        words = self._count * self._dtype.itemsize // _WORD
        self._numbers = memory
        self._head = memory[1 : len(_SCALARS)]
        self.plants = memory[:words].view(self._dtype)
        self.u_nominal: Array = self.plants["u_nominal"]
        rows = memory[words:]
        self.rows: Records = rows.view(ROW).reshape(self._count, self._total)
        self.words = numbers_of(self.plants), rows.reshape(self._count, -1)
        self.core.set_report(*self.words)

    def filter(self, scene: BarrierSet, own: Array = NO_ROWS) -> int:
        """Filter the plants by the compiled program or a solver.

        Args:
            scene: the scenes of the plants.
            own: (N, m, WIDTH + n_u) the rows that Python makes.

        Returns:
            The result of the step, such as `solvers.DONE`.
        """
        kind, parameters, priority, own_margin, atlas, ends, rows = self._scene
        same = kind is scene.kind and parameters is scene.parameters and own is rows
        same = same and priority is scene.priority and own_margin is scene.own_margin
        if not (same and atlas is scene.atlas.numbers and ends is scene.ends):
            arrays = scene.kind, scene.parameters, scene.priority, scene.own_margin
            self._scene = SceneArrays(*arrays, scene.atlas.numbers, scene.ends, own)
            self.core.set_scene(*self._scene)
        if self._config.solver is None:
            return self.core.filter()
        return solvers.answer(self._config.solver, self.core, self._count)

    def report(self) -> Info:
        """Return the report of the last step, a dict by the names of fields."""
        if not self._alone:
            report = {name: self.plants[name] for name in _PLANTS}
            return report | {name: self.rows[name][:, : self._m] for name in _ROWS}
        head = self._head.tobytes()
        if head != self._reported:
            self._reported = head
            self._scalars = {name: self.plants[name][0] for name in _SCALARS}
        report = self._scalars.copy()
        numbers = self._numbers.copy()
        for name, place in self._places:
            report[name] = numbers[place]
        return report

    def copy_of_last_step(self) -> _core.Filter | None:
        """Return a compiled filter that can repeat the last step, on copies; None before any."""
        if self._scene.kind is None:
            return None
        sensed = self._samples.plants.copy()
        sensed["known"] = 0  # so that the time of the same sample is accepted again
        config = self._config
        repeated = _core.Filter(config.words.copy(), config.program, numbers_of(sensed), 1)
        if config.gate is not None:
            repeated.set_laws(config.gate.input)
        repeated.set_scene(*self._scene)
        repeated.set_report(*(words.copy() for words in self.words))
        return repeated


def _places(dtype: np.dtype[np.void], m: int) -> list[tuple[str, int | slice]]:
    """Return the places, in the array of one plant's report, of fields that change every step."""
    start, step = dtype.itemsize // _WORD, _ROW_WORDS
    n_u, at = dtype["u_safe"].shape[0], len(_SCALARS)
    places: list[tuple[str, int | slice]] = [("intervention", 0)]
    places += [("u_nominal", slice(at, at + n_u)), ("u_safe", slice(at + n_u, at + 2 * n_u))]
    return places + [
        (name, slice(start + k, start + k + m * step, step)) for k, name in enumerate(_ROWS)
    ]
