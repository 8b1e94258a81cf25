"""The compiled filter of N plants, bound to the arrays that it reads and to its report.

The report, ``info["safety_filter"]``, has the fields of `report` in `plants.hpp`. The keys are the
same for every filter; a field that a filter does not write is 0. The memory of a report holds the
structs of all plants, then the structs of all rows. Each number is a word of 8 bytes:

    plant: intervention, other scalars, u_nominal (n_u), u_safe (n_u) | row 0: … | row 1: … | …
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
"""No rows, for steps in which compiled code makes them all."""


@cache
def report_dtype(n_u: int) -> np.dtype[np.void]:
    """Return the type of the report of a plant with n_u inputs; u* and u are behind the struct."""
    return record_type("report.Plant", u_nominal=n_u, u_safe=n_u)


ROW = record_type("report.Row")
"""The type of the report of a row; rows are in the order of the barriers."""

_ROW_FIELDS = ROW.names or ()
_PLANT_FIELDS = report_dtype(2).names or ()
_SCALAR_FIELDS = _PLANT_FIELDS[:-2]
_WORD_BYTES = 8
_ROW_WORDS = ROW.itemsize // _WORD_BYTES


class SceneArrays(NamedTuple):
    """The arrays of a `BarrierSet` that the compiled filter reads; None before the first step."""

    kind: Any = None
    parameters: Any = None
    priority: Any = None
    own_margin: Any = None
    atlas: Any = None
    ends: Any = None
    python_rows: Any = None  # (N, m, WIDTH + n_u) the rows that Python makes


class Bound:
    """Filters N plants in compiled code, which is bound anew when arrays are replaced.

    `batch` is N of a batch, or None for one plant, whose report has no leading N.

    Attributes:
        core: the compiled filter.
        plants: (N,) the reports of the plants, of the type `report_dtype`.
        rows: (N, M) the reports of the rows, of the type `ROW`; M is m, or m + 1 with guidance.
        u_nominal: (N, n_u) u*, a view of `plants`.
        words: `plants` and `rows` as numbers (N, …), for the core.
    """

    def __init__(self, config: FilterConfig, samples: Samples, batch: int | None, threads: int):
        self._config, self._samples, self._threads = config, samples, threads
        self._alone, self._count = batch is None, config.count
        self._dtype = report_dtype(config.input_set.n_u)
        self.plants: Records = np.zeros(self._count, dtype=self._dtype)
        self.plants["alpha1_scale"] = config.alpha1_scale
        self._make_core()
        self.resize(0, 0)

    def _make_core(self) -> None:
        """Make the compiled filter, which is not bound to scenes yet."""
        config, samples = self._config, self._samples
        self.core = _core.Filter(config.words, config.program, samples.words, self._threads)
        if samples.is_apart:
            self.core.set_states(*samples.states)
        if config.gate is not None:
            self.core.set_laws(config.gate.input)
        self._arrays = SceneArrays()

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a copy, without the core and the views of `_memory`."""
        bound = "core", "plants", "rows", "u_nominal", "words", "_constant_words"
        return {name: value for name, value in vars(self).items() if name not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        arrays = self._arrays
        self._make_core()
        self._set_views(self._memory)
        if arrays.kind is not None:  # `copy_of_last_step` needs the scenes of the last step
            self._arrays = arrays
            self.core.set_scene(*arrays)

    def resize(self, m: int, total: int) -> None:
        """Allocate a report of `total` rows for each plant, of which the user gets the first m."""
        previous, self._m, self._total = self.plants, m, total
        words = self._dtype.itemsize // _WORD_BYTES + total * _ROW_WORDS
        self._set_views(np.zeros(self._count * words))
        self.plants[...] = previous
        if self._alone:
            self._places = _places_of_changing_fields(self._dtype, m)
            self._last_constants, self._scalars = b"", {}

    def renew(self) -> None:
        """Allocate the next report, because the user has the last one; a step writes all rows."""
        previous_plants, _ = self.words
        self._set_views(np.empty_like(self._memory))
        self.words[0][...] = previous_plants
        # the user may have written to the last report
        self.plants["alpha1_scale"] = self._config.alpha1_scale

    def _set_views(self, memory: Array) -> None:
        """Let both reports be views of one array, which `report` copies at once."""
        words = self._count * self._dtype.itemsize // _WORD_BYTES
        self._memory = memory
        # all scalars of the first plant but the intervention, which changes at every step
        self._constant_words = memory[1 : len(_SCALAR_FIELDS)]
        self.plants = memory[:words].view(self._dtype)
        self.u_nominal: Array = self.plants["u_nominal"]
        rows = memory[words:]
        self.rows: Records = rows.view(ROW).reshape(self._count, self._total)
        self.words = numbers_of(self.plants), rows.reshape(self._count, -1)
        self.core.set_report(*self.words)

    def filter(self, scenes: BarrierSet, python_rows: Array = NO_ROWS) -> int:
        """Filter the plants in their scenes, and return the result, such as `solvers.DONE`.

        `python_rows` (N, m, WIDTH + n_u) are the rows that Python makes.
        """
        kind, parameters, priority, own_margin, atlas, ends, bound_rows = self._arrays
        if not (
            kind is scenes.kind
            and parameters is scenes.parameters
            and priority is scenes.priority
            and own_margin is scenes.own_margin
            and atlas is scenes.atlas.numbers
            and ends is scenes.ends
            and bound_rows is python_rows
        ):
            arrays = scenes.kind, scenes.parameters, scenes.priority, scenes.own_margin
            self._arrays = SceneArrays(*arrays, scenes.atlas.numbers, scenes.ends, python_rows)
            self.core.set_scene(*self._arrays)
        if self._config.solver is None:
            return self.core.filter()
        return solvers.filter_by_solver(self._config.solver, self.core, self._count)

    def report(self) -> Info:
        """Return the report of the last step, a dict by the names of its fields."""
        if not self._alone:
            report = {name: self.plants[name] for name in _PLANT_FIELDS}
            return report | {name: self.rows[name][:, : self._m] for name in _ROW_FIELDS}
        # scalars, such as the status, rarely change, so that their objects are used again
        constants = self._constant_words.tobytes()
        if constants != self._last_constants:
            self._last_constants = constants
            self._scalars = {name: self.plants[name][0] for name in _SCALAR_FIELDS}
        report = self._scalars.copy()
        memory = self._memory.copy()
        for name, place in self._places:
            report[name] = memory[place]
        return report

    def copy_of_last_step(self) -> _core.Filter | None:
        """Return a compiled filter that can repeat the last step, on copies; None before any."""
        if self._arrays.kind is None:
            return None
        plants = self._samples.plants.copy()
        plants["known"] = 0  # so that the time of the same sample is accepted again
        config = self._config
        repeated = _core.Filter(config.words.copy(), config.program, numbers_of(plants), 1)
        if config.gate is not None:
            repeated.set_laws(config.gate.input)
        repeated.set_scene(*self._arrays)
        repeated.set_report(*(words.copy() for words in self.words))
        return repeated


def _places_of_changing_fields(dtype: np.dtype[np.void], m: int) -> list[tuple[str, int | slice]]:
    """Return the fields that change at every step, and their places in a report with m rows."""
    n_u = dtype["u_safe"].shape[0]
    u_nominal = len(_SCALAR_FIELDS)
    u_safe = u_nominal + n_u
    places: list[tuple[str, int | slice]] = [
        ("intervention", 0),
        ("u_nominal", slice(u_nominal, u_safe)),
        ("u_safe", slice(u_safe, u_safe + n_u)),
    ]
    first_row = dtype.itemsize // _WORD_BYTES
    end = first_row + m * _ROW_WORDS
    for k, name in enumerate(_ROW_FIELDS):
        places.append((name, slice(first_row + k, end + k, _ROW_WORDS)))
    return places
