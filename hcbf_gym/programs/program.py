"""What every program shares: how it is called, and the check of its rows."""

from abc import ABC, abstractmethod
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, holds_numbers, instance, shown
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.plans import Plan
from hcbf_gym.programs.prices import Prices
from hcbf_gym.programs.result import FilterResult


class Program(ABC):
    """A safety filter ``(u*, rows) → FilterResult``: a plan with its prices over one input set.

    Attributes:
        plan: what is solved.
        prices: its numbers.
        input_set: U.
    """

    plan: Plan
    prices: Prices
    input_set: InputSet

    @abstractmethod
    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input.

        Args:
            u_nominal: (n_u,) u*, inside U or not, of 32 or 64 bits; the result has 64.
            rows: the rows of one state, m ≥ 0.

        Returns:
            The filtered input and what it costs. Where no solver has an answer, the braking
            action 0 with status BACKUP.

        Raises:
            InvalidInputError: on malformed input or rows.
        """


def check_rows(rows: CbfRows, n_u: int) -> None:
    """Refuse rows, of one state or of N with a leading axis, that no program can read.

    Raises:
        InvalidInputError: on shapes that do not match, entries that are not finite, or priorities
            that are not the integers from 1 without a gap.
    """
    check_shapes(rows, n_u)
    if rows.alpha2_psi is not None and not np.isfinite(rows.alpha2_psi).all():
        raise InvalidInputError(f"rows.alpha2_psi: got {rows.alpha2_psi}, expected finite numbers")
    parts = rows.a, rows.b, rows.h, rows.priority
    states = zip(*parts, strict=True) if rows.b.ndim > 1 else [parts]
    if not all(_core.well_formed(*state) for state in states):
        explain(rows)


def check_shapes(rows: CbfRows, n_u: int) -> None:
    """Refuse rows whose arrays do not fit each other, or whose priorities are no integers.

    Raises:
        InvalidInputError: on such rows.
    """
    instance("rows", rows, CbfRows)
    for name, part in zip(CbfRows._fields, rows, strict=True):
        is_left_out = part is None and name == "alpha2_psi"
        if not is_left_out and not (type(part) is np.ndarray and holds_numbers(part.dtype)):
            raise InvalidInputError(
                f"rows.{name}: got {shown(part)}, expected an array of real numbers"
            )
    shape = rows.b.shape
    expected = {"a": (*shape, n_u), "h": shape, "priority": shape}
    if rows.alpha2_psi is not None:
        expected["alpha2_psi"] = shape
    for name, needed in expected.items():
        got = getattr(rows, name).shape
        if got != needed:
            raise InvalidInputError(f"rows.{name}: got shape {got}, expected {needed}")
    if rows.priority.dtype.kind not in "iu":
        raise InvalidInputError(
            f"rows.priority: got {rows.priority.dtype}, expected integers from 1"
        )


def explain(rows: CbfRows) -> NoReturn:
    """Raise the error of entries that are not finite, or priorities with a gap."""
    for name in ("a", "b", "h", "alpha2_psi"):
        value = getattr(rows, name)
        if value is not None and not np.isfinite(value).all():
            raise InvalidInputError(f"rows.{name}: got {value}, expected finite numbers")
    raise InvalidInputError(
        f"rows.priority: got {rows.priority.tolist()}, expected the integers from 1 without a gap"
    )
