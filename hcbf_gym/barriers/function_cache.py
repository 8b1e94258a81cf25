"""The compiled rows of users' functions, and groups of scenes that share them."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function, Signature
from hcbf_gym.barriers.function_group import Group
from hcbf_gym.barriers.function_rows import RowsKernel
from hcbf_gym.errors import warn_caller
from hcbf_gym.models.reduced_order import ReducedOrderModel

MAX_TUPLES = 8
"""The number of tuples of functions whose rows are compiled together."""


class FunctionCache:
    """Compiles the rows of the first `MAX_TUPLES` tuples of functions, and keeps them.

    The functions of a later tuple that are in one of these are compiled one by one, because a
    sensor may report a changing number of obstacles. Functions that are in none of these are
    evaluated without compiling, which is slow, with one warning. Arguments are as of `RowsKernel`.
    """

    def __init__(self, model: ReducedOrderModel, alpha1: ClassK, alpha2: ClassK) -> None:
        self._model, self._alphas = model, (alpha1, alpha2)
        self.by_tuple: dict[tuple[Signature, ...], RowsKernel] = {}
        self.by_function: dict[Signature, RowsKernel] = {}  # for functions of later tuples
        self._has_warned = False

    def groups(self, scenes: Sequence[Sequence[Any]]) -> list[Group]:
        """Return the functions of N scenes; those of the same signatures and places are a group.

        Raises:
            InvalidInputError: if no input reaches a function, or it cannot be differentiated.
        """
        members_of: dict[tuple[tuple[int, ...], tuple[Signature, ...]], list[int]] = {}
        for i, scene in enumerate(scenes):
            places = tuple(k for k, one in enumerate(scene) if isinstance(one, Function))
            if places:
                signatures = tuple(scene[k].signature for k in places)
                members_of.setdefault((places, signatures), []).append(i)
        groups = []
        for (places, _), members in members_of.items():
            first_scene = scenes[members[0]]
            for group_places, kernel in self._kernels(first_scene, places):
                functions = tuple(first_scene[k] for k in group_places)
                parameters = np.array(
                    [np.concatenate([scenes[i][k].packed for k in group_places]) for i in members]
                )
                indices = np.array(members), np.array(group_places)
                groups.append(Group(*indices, kernel, functions, parameters))
        return groups

    def _kernels(
        self, scene: Sequence[Any], places: tuple[int, ...]
    ) -> Iterator[tuple[tuple[int, ...], RowsKernel]]:
        """Yield the rows of a scene's functions with their places: together, or one by one."""
        functions = [scene[k] for k in places]
        signatures = tuple(function.signature for function in functions)
        if signatures not in self.by_tuple and len(self.by_tuple) < MAX_TUPLES:
            self.by_tuple[signatures] = RowsKernel(self._model, functions, *self._alphas)
        if signatures in self.by_tuple:
            yield places, self.by_tuple[signatures]
            return
        for k, function in zip(places, functions, strict=True):
            yield (k,), self._kernel_of(function)

    def _kernel_of(self, function: Function) -> RowsKernel:
        """Return the rows of one function of a tuple that is not compiled together."""
        if function.signature in self.by_function:
            return self.by_function[function.signature]
        is_known = any(function.signature in signatures for signatures in self.by_tuple)
        kernel = RowsKernel(self._model, [function], *self._alphas, compiled=is_known)
        if is_known:
            self.by_function[function.signature] = kernel
        elif not self._has_warned:
            self._has_warned = True
            warn_caller(
                f"{function.name}: got yet another function after {MAX_TUPLES} that were compiled; "
                "from now on such rows are evaluated without compiling, a hundred times slower; "
                "expected the same function object in every step: pass what changes as an "
                "argument, barriers.Function(name, priority, h, parameters=p) with h(x, t, p)",
            )
        return kernel
