"""The base class of all programs, and the checks of the rows that they read."""

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
        plan: the stages that are solved.
        prices: the weights of violations.
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
            The filtered input and the violations. If every solver fails, it is the braking action
            0 with the status BACKUP.

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
    arrays = rows.a, rows.b, rows.h, rows.priority
    states = zip(*arrays, strict=True) if rows.b.ndim > 1 else [arrays]
    if not all(_core.well_formed(*state) for state in states):
        explain(rows)


def check_shapes(rows: CbfRows, n_u: int) -> None:
    """Refuse rows whose arrays do not fit each other, or whose priorities are no integers."""
    instance("rows", rows, CbfRows)
    for name, value in rows._asdict().items():
        if value is None and name == "alpha2_psi":
            continue
        if not (type(value) is np.ndarray and holds_numbers(value.dtype)):
            raise InvalidInputError(
                f"rows.{name}: got {shown(value)}, expected an array of real numbers"
            )
    shape = rows.b.shape
    expected_shapes = {"a": (*shape, n_u), "h": shape, "priority": shape}
    if rows.alpha2_psi is not None:
        expected_shapes["alpha2_psi"] = shape
    for name, expected in expected_shapes.items():
        got = getattr(rows, name).shape
        if got != expected:
            raise InvalidInputError(f"rows.{name}: got shape {got}, expected {expected}")
    if rows.priority.dtype.kind not in "iu":
        raise InvalidInputError(
            f"rows.priority: got {rows.priority.dtype}, expected integers from 1"
        )


def explain(rows: CbfRows) -> NoReturn:
    """Raise the error of malformed rows: an entry is not finite, or the priorities have a gap."""
    for name in ("a", "b", "h", "alpha2_psi"):
        value = getattr(rows, name)
        if value is not None and not np.isfinite(value).all():
            raise InvalidInputError(f"rows.{name}: got {value}, expected finite numbers")
    raise InvalidInputError(
        f"rows.priority: got {rows.priority.tolist()}, expected the integers from 1 without a gap"
    )
