"""Functions of many scenes in groups, and which of their rows are compiled, for how long."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_group import Group
from hcbf_gym.barriers.function_rows import RowsKernel
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

    def groups(self, scenes: Sequence[Sequence[Any]]) -> list[Group]:
        """Return the functions of N scenes, those of the same signatures together.

        Raises:
            InvalidInputError: if no input reaches a function, or it cannot be differentiated.
        """
        alike: dict[tuple[tuple[int, ...], tuple[object, ...]], list[int]] = {}
        for i, scene in enumerate(scenes):
            places = tuple(k for k, one in enumerate(scene) if isinstance(one, Function))
            if places:
                alike.setdefault((places, tuple(scene[k].signature for k in places)), []).append(i)
        found = []
        for (places, key), members in alike.items():
            first = [scenes[members[0]][k] for k in places]
            kernel = self._kernel(key, first)
            parts = [(places, kernel)] if kernel else [((k,), None) for k in places]
            for part, made in parts:
                functions = tuple(scenes[members[0]][k] for k in part)
                packed = [np.concatenate([scenes[i][k].packed for k in part]) for i in members]
                kernel = made or self._one(functions[0])
                where = np.array(members), np.array(part)
                found.append(Group(*where, kernel, functions, np.array(packed)))
        return found

    def _kernel(self, key: tuple[object, ...], functions: list[Function]) -> RowsKernel | None:
        """Return the rows of functions that are compiled together; None where they are not."""
        model, alpha1, alpha2 = self._of
        if key not in self.together and len(self.together) < MOST:
            self.together[key] = RowsKernel(model, functions, alpha1, alpha2)
        return self.together.get(key)

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
