"""The record between barriers and programs, ``a·u ≥ b``, and how barriers become rows.

Compiled code reads and writes rows as one array, whose columns are named here. Python code outside
of this file and of the planar rows reads them by the fields of `PackedRows`.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Pair
from hcbf_gym.barriers.class_k import ClassK, LogClassK, unless_given
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float, instance

B, H, ALPHA2_PSI, PSI = range(4)
"""The columns of every row: its bound b, h, α₂(ψ) and ψ."""
MARGIN, RATE, QUICKENING, USABLE, REACH, FAST, DIP, CONDITIONING, PLACED, WIDTH = range(4, 14)
"""The further columns of a row for any model: its margin m with ṁ and m̈, three terms of
margins.hpp, the dip of h between samples, the conditioning of a, and 1 where the barrier reads the
position. a (n_u,) begins at `WIDTH`."""


def _column(column: int) -> Any:
    """Return a property of rows that is a view (N, m) of one column."""
    return property(lambda rows: rows.numbers[..., column])


class PackedRows(NamedTuple):
    """Rows of N states in the array of compiled code. The properties are views of its columns.

    Attributes:
        numbers: (N, m, WIDTH + n_u) the columns above, then a.
    """

    numbers: Array

    b = _column(B)
    h = _column(H)
    alpha2_psi = _column(ALPHA2_PSI)
    margin = _column(MARGIN)
    margin_rate = _column(RATE)
    conditioning = _column(CONDITIONING)
    reads_position = _column(PLACED)

    @property
    def a(self) -> Array:
        """(N, m, n_u) L_g ψ."""
        return self.numbers[..., WIDTH:]


class States(NamedTuple):
    """N states at which rows are made, with the terms of ẋ = f(x) + g(x)u there."""

    x: Array  # (N, n)
    t: Array  # (N,) [s]
    f: Array  # (N, n)
    g: Array  # (N, n, n_u)


class CbfRows(NamedTuple):
    """The conditions of one state, ``a_k·u ≥ b_k``, or of N states with a leading axis.

    With ``ψ`` the barrier at its relative degree, ``a = L_g ψ`` and ``b = −α₂(ψ) − L_f ψ``, so
    that ``a·u − b = ψ̇(x, u) + α₂(ψ)``.

    Attributes:
        a: (m, n_u) ``L_g ψ_k``, the row's gradient in the input.
        b: (m,) the row's lower bound.
        h: (m,) the barriers' values h_k, which the weight λ_δ(h) reads.
        priority: (m,) int, 1 is the highest and strict; rows of one priority are one stage.
        alpha2_psi: (m,) α₂(ψ_k), from which R-CBF-QP's ``epsilon="known"`` takes its least slack.
    """

    a: Array
    b: Array
    h: Array
    priority: Integers
    alpha2_psi: Array | None = None


@dataclass(frozen=True)
class RowSettings:
    """How barriers become rows: α₁, α₂, and for how long an input is held.

    Args:
        alpha1: α₁, applied to h at relative degree 2; the paper's logarithm unless given.
        alpha2: α₂, applied to ψ; linear with gain ``min(10, 0.5/T)`` [1/s] unless given.
        period: T, how long u is held [s]: rows then preserve h ≥ 0 between two samples, too.
            None makes the usual rows, which look at the sample alone.
        u_max: the largest norm of an input [m/s²]; a held row needs it, and a row that is late
            requests no more.
        limits: ((2,), (2,)) the least and the greatest inputs of U [m/s²]; None where only
            `u_max` limits them.
        alpha_speed: α of speed limits and zones, applied to h; as α₂ is unless given.

    Raises:
        InvalidInputError: if a number is not positive and finite, if `u_max` is missing, or if T
            is longer than 1/α'(0) of any of the functions (0.2 s by default).
    """

    alpha1: ClassK = field(default_factory=LogClassK)
    alpha2: Any = None
    period: float | None = None
    u_max: float | None = None
    limits: tuple[Pair, Pair] | None = None
    alpha_speed: Any = None

    def __post_init__(self) -> None:
        period = self.period
        if period is not None:
            finite_float("period", period, minimum=0.0, exclusive=True)
        for name in ("alpha2", "alpha_speed"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, unless_given(period))
        for name, alpha in self.alphas.items():
            instance(name, alpha, ClassK)
        if self.u_max is not None:
            finite_float("u_max", self.u_max, minimum=0.0, exclusive=True)
        if self.limits is not None:
            finite_array("limits", self.limits, (2, 2))
        if period is None:
            return
        if self.u_max is None:
            raise InvalidInputError("u_max: got None, expected a number for rows of a held input")
        steepest = max(alpha.derivative(0.0) for alpha in self.alphas.values())
        if steepest * period > 1.0:
            raise InvalidInputError(
                f"period: got {period} s with class-K slopes up to {steepest:g} 1/s, expected at "
                f"most {1.0 / steepest:g} s: sample faster, take flatter functions or usual rows"
            )

    @property
    def alphas(self) -> dict[str, ClassK]:
        """The three functions by their names."""
        return {name: getattr(self, name) for name in ("alpha1", "alpha2", "alpha_speed")}

    @property
    def held(self) -> bool:
        """Whether rows cover the time between two samples, while an input is held."""
        return self.period is not None

    @cached_property
    def packed(self) -> Array:
        """(19,) `alphas` (4 each), T, u_max, 1 for held rows, least and greatest inputs (2)."""
        low, high, u_max = (0.0, 0.0), (0.0, 0.0), 0.0
        if self.u_max is not None:
            u_max = self.u_max
            low, high = self.limits or ((-u_max, -u_max), (u_max, u_max))
        alphas = np.ravel([alpha.parameters() for alpha in self.alphas.values()])
        packed = np.array([*alphas, self.period or 0.0, u_max, self.held, *low, *high])
        packed.flags.writeable = False
        return packed
