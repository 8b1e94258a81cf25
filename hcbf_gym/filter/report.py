"""The layout of ``info["safety_filter"]``; its fields are those of `report` in `plants.hpp`.

The keys are the same for every filter. A field that a filter does not write is 0.
"""

from functools import cache

import numpy as np

from hcbf_gym.arrays import Array, Info, Records, record_type


@cache
def plant_dtype(n_u: int) -> np.dtype[np.void]:
    """Return what is reported of a plant of so many inputs; u* and u are behind the struct."""
    return record_type("report.Plant", u_nominal=n_u, u_safe=n_u)


PLANT = plant_dtype(2)
"""What is reported of a plant of two inputs."""

ROW = record_type("report.Row")
"""What is reported of each row (m,), in the order of the barriers."""

_ROWS = ROW.names or ()
_PLANTS = PLANT.names or ()
_SCALARS = _PLANTS[:-2]
_WORD = 8  # bytes of a number or a code
ROW_WORDS = ROW.itemsize // _WORD
"""Numbers of a row."""


class ReportBuffer:
    """Where compiled code writes the reports of plants.

    Args:
        count: N of a batch; None for one plant, whose report has no leading N.
        n_u: the number of inputs.

    Attributes:
        plants: (N,) `PLANT`.
        rows: (N, M) `ROW`; M is m, and one more with guidance.
        u_nominal: (N, n_u) of `plants`.
        words: (N, …) the numbers that `plants` and `rows` are made of.
    """

    def __init__(self, count: int | None, n_u: int = 2):
        self._alone = count is None
        self._count = 1 if count is None else count
        self._dtype = plant_dtype(n_u)
        self.plants: Records = np.zeros(self._count, dtype=self._dtype)
        self.widen(0, 0)

    def widen(self, m: int, total: int) -> None:
        """Make room for `total` rows, of which m are reported."""
        before = self.plants
        words = total * self._count * ROW_WORDS
        self._m, self._total = m, total
        self._divide(np.zeros(self._count * self._dtype.itemsize // _WORD + words))
        self.plants[...] = before
        if self._alone:
            self._places = _places(self._dtype, m)
            self._reported, self._scalars = b"", {}

    def renew(self) -> None:
        """Take new memory for the next report."""
        before, _ = self.words
        self._divide(np.empty_like(self._numbers))
        self.words[0][...] = before  # every step writes all rows

    def _divide(self, memory: Array) -> None:
        """Let the two records be parts of one memory, which is copied at once."""
        words = self._count * self._dtype.itemsize // _WORD
        self._numbers = memory
        self._head = memory[1 : len(_SCALARS)]
        plants, rows = memory[:words], memory[words:]
        self.words = (
            plants.reshape(self._count, -1),
            rows.reshape(self._count, self._total * ROW_WORDS),
        )
        self.plants = plants.view(self._dtype)
        self.u_nominal: Array = self.plants["u_nominal"]
        self.rows: Records = rows.view(ROW).reshape(self._count, self._total)

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy needs; its records look into its own memory."""
        parts = ("plants", "rows", "u_nominal", "words", "_head")
        return {name: value for name, value in vars(self).items() if name not in parts}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._divide(self._numbers)

    def report(self) -> Info:
        """Return what was written, by its names."""
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


def _places(dtype: np.dtype[np.void], m: int) -> list[tuple[str, int | slice]]:
    """Return where one plant's memory holds the fields that differ from step to step."""
    start, step = dtype.itemsize // _WORD, ROW_WORDS
    n_u, at = dtype["u_safe"].shape[0], len(_SCALARS)
    places: list[tuple[str, int | slice]] = [("intervention", 0)]
    places += [("u_nominal", slice(at, at + n_u)), ("u_safe", slice(at + n_u, at + 2 * n_u))]
    return places + [
        (name, slice(start + k, start + k + m * step, step)) for k, name in enumerate(_ROWS)
    ]
