"""Which rows of functions are compiled, and for how long that is retained."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_rows import FunctionRows, RowsKernel
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.errors import warn_caller
from hcbf_gym.models.reduced_order import ReducedOrderModel

MOST = 8
"""Tuples of functions that are compiled together."""


class FunctionCache:
    """Compiles the first `MOST` tuples of functions that it meets, and holds no others.

    The functions of a later tuple that are in one of these are compiled one by one: what a sensor
    sees may change in number. Functions that are new again are evaluated without compiling, which
    is slow, with one warning.

    Args:
        model: ẋ = f(x) + g(x)u.
        alpha1: α₁.
        alpha2: α₂.
    """

    def __init__(self, model: ReducedOrderModel, alpha1: ClassK, alpha2: ClassK) -> None:
        self._of = model, alpha1, alpha2
        self.together: dict[tuple[object, ...], RowsKernel] = {}
        self.alone: dict[object, RowsKernel] = {}
        self._warned = False

    def rows(self, scenes: Sequence[Sequence[Function]]) -> "FunctionRows | SeparateRows":
        """Return what makes the rows of m ≥ 1 functions in each of N scenes.

        Args:
            scenes: N sequences of m functions that differ in their parameters alone.

        Raises:
            InvalidInputError: if no input reaches a function, or it cannot be differentiated.
        """
        model, alpha1, alpha2 = self._of
        functions = scenes[0]
        key = tuple(function.signature for function in functions)
        if key not in self.together and len(self.together) < MOST:
            self.together[key] = RowsKernel(model, functions, alpha1, alpha2)
        if key in self.together:
            return FunctionRows(self.together[key], scenes)
        return SeparateRows(
            [
                FunctionRows(self._one(function), [(one[k],) for one in scenes])
                for k, function in enumerate(functions)
            ]
        )

    def _one(self, function: Function) -> RowsKernel:
        """Return the rows of one function of a tuple that is not compiled together."""
        model, alpha1, alpha2 = self._of
        known = self.alone.get(function.signature)
        if known is not None:
            return known
        kept = any(function.signature in key for key in self.together)
        kernel = RowsKernel(model, [function], alpha1, alpha2, compiled=kept)
        if kept:
            self.alone[function.signature] = kernel
        elif not self._warned:
            self._warned = True
            warn_caller(
                f"{function.name}: got yet another function after {MOST} that were compiled; from "
                "now on such rows are evaluated without compiling, a hundred times slower; "
                "expected the same function object in every step: pass what changes as an "
                "argument, barriers.Function(name, priority, h, parameters=p) with h(x, t, p)",
            )
        return kernel


class SeparateRows:
    """The rows of m functions, each evaluated alone."""

    def __init__(self, parts: Sequence[FunctionRows]) -> None:
        self._parts = parts
        self.reaches: list[Reach] = [part.reaches[0] for part in parts]

    def __call__(self, x: Array, t: Array, margin: Array, margin_rate: Array) -> Array:
        """Return the rows; see `FunctionRows`."""
        each = [
            part(x, t, margin[:, k : k + 1], margin_rate[:, k : k + 1])
            for k, part in enumerate(self._parts)
        ]
        return np.concatenate(each, axis=1)
