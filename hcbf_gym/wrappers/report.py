"""What ``info["safety_filter"]`` says: its layout stands here, once; a line here is a field of it.

Beside these fields stands `u_nominal`, u* (n_u,), as the filter received it. Plants other than the
planar double integrator add `conditioning` (m,): 0 where no input matters to a row, less than 1
near a kink of its function. A field that a filter does not write is 0.
"""

import operator
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Records = NDArray[Any]

PLANT = np.dtype(
    (
        np.record,
        [
            ("u_safe", "f8", 2),  # u, what the environment receives
            ("intervention", "f8"),  # ‖u − u*‖
            ("fallbacks", "f8"),  # quadratic programs that a second solver had to answer
            ("model_error", "f8"),  # how far the response is from the chosen input [unit of u]
            ("reachable", "f8"),  # through which rank the way leads; 0 where nothing lies on it
            ("deadlock", "f8"),  # 1 where the plant stands though u* asks it to move
            ("alpha1_scale", "f8"),  # by how much α₁ was scaled down to what U can brake
            ("status", "i8"),  # a `programs.FilterStatus`
            ("reason", "i8"),  # a `models.plant.Reason`
            ("covered", "i8"),  # a `models.plant.Coverage`
        ],
    )
)
"""What is said of a plant."""

ROW = np.dtype(
    (
        np.record,
        [
            ("slack", "f8"),  # the row's violation
            ("delta", "f8"),  # the program's own relaxation
            ("margin", "f8"),  # what the row keeps between h and zero
        ],
    )
)
"""What is said of each row (m,)."""

WORD = 8
"""Bytes of a number or a code."""


def of_one(u_nominal: Array, u_safe: Array, rows: dict[str, Array], told: dict[str, Any]) -> Any:
    """Return the report of one plant of any number of inputs.

    Args:
        u_nominal: (n_u,) u*.
        u_safe: (n_u,) u.
        rows: what is said of the rows, (m,) each.
        told: numbers and codes by their names; the others are 0.
    """
    report: dict[str, Any] = {"u_nominal": u_nominal.copy(), "u_safe": u_safe.copy()}
    report |= {name: column.copy() for name, column in rows.items()}
    return report | {name: kind.type(told.get(name, 0)) for name, kind, _ in _scalars()}


class Sheet:
    """Where compiled code writes what is said of the plants that it filters.

    Args:
        count: N of a batch; None for one plant, whose report has no leading N.

    Attributes:
        plants: (N,) `PLANT`.
        rows: (N, M) `ROW`; M is m, and one more with guidance.
    """

    def __init__(self, count: int | None):
        self._alone = count is None
        self.plants: Records = np.zeros(1 if count is None else count, dtype=PLANT)
        self.widen(0, 0)

    def widen(self, m: int, total: int) -> None:
        """Make room for `total` rows, of which m are reported."""
        count, told = len(self.plants), self.plants
        words = count * (PLANT.itemsize + total * ROW.itemsize) // WORD
        self._m, self._total, self._memory = m, total, np.zeros(words)
        self._divide()
        self.plants[...] = told
        if self._alone:
            start = PLANT.itemsize // WORD
            step = ROW.itemsize // WORD
            rows = [
                (name, slice(start + k, start + m * step, step)) for k, name in enumerate(_ROWS)
            ]
            numbers = [(name, at) for name, kind, at in _scalars() if kind == np.float64]
            codes = [(name, at) for name, kind, at in _scalars() if kind == np.int64]
            names, places = zip(("u_safe", slice(0, 2)), *rows, *numbers, strict=True)
            code_names, code_places = zip(*codes, strict=True)
            self._names = (*names, *code_names)
            self._numbers_of = operator.itemgetter(*places)
            self._codes_of, self._codes = operator.itemgetter(*code_places), self._memory.view("i8")

    def _divide(self) -> None:
        """Let the two records be parts of one memory, which is copied at once."""
        words = len(self.plants) * PLANT.itemsize // WORD
        self.plants = self._memory[:words].view(PLANT)
        self.rows: Records = self._memory[words:].view(ROW).reshape(len(self.plants), self._total)

    def renew(self) -> None:
        """Give a batch's next report memory of its own; that of one plant is copied."""
        if not self._alone:
            self._memory = self._memory.copy()
            self._divide()

    def report(self, u_nominal: Array) -> dict[str, Any]:
        """Return what was written, by its names."""
        if self._alone:
            told = (*self._numbers_of(self._memory.copy()), *self._codes_of(self._codes))
            report: dict[str, Any] = dict(zip(self._names, told, strict=True))
            report["u_nominal"] = u_nominal
            return report
        report = {"u_nominal": u_nominal}
        report |= {name: self.rows[name][:, : self._m] for name in _ROWS}
        return report | {name: self.plants[name] for name in PLANT.names or ()}


_ROWS = ROW.names or ()


def _scalars() -> Iterator[tuple[str, np.dtype[Any], int]]:
    """Yield each scalar of `PLANT`, its kind, and at which word of the record it stands."""
    for name, (kind, at, *_) in (PLANT.fields or {}).items():
        if kind.shape == ():
            yield name, kind, at // WORD
