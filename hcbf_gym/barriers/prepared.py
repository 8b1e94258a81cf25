"""The barriers of N scenes of any model, with what stays the same from state to state."""

import operator
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache, Group
from hcbf_gym.barriers.layout import ELSEWHERE
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.set import BarrierSet

Conditions = tuple[Barrier, ...]


class Scene(NamedTuple):
    """The barriers of N scenes, as compiled code reads them."""

    kind: Integers  # (N, m) as `layout` has it, `NONE` behind a shorter scene; or `ELSEWHERE`
    parameters: Array  # (N, m, WIDTH) the blocks of built-in ones
    degree: Integers  # (N, m) the derivative of h that an input enters first, 1 or 2


class Prepared(NamedTuple):
    """The barriers of N scenes, with what stays the same from state to state.

    Attributes:
        scenes: N tuples of at most m of them; behind a shorter one there is no row.
        groups: those that are functions.
        custom: scene, place and barrier of users' own classes.
        scene: the others.
        reaches: how inputs reach the barriers of each scene, of the first alone where all are one.
        turns: whether an input enters the second derivative of a barrier that is no function.
        priority: (N, m), 0 where there is no row.
        least: (N, m) what a row reserves itself: a speed limit's margin.
        share: (N, m) how much of a margin on the position a row reserves.
    """

    scenes: tuple[Conditions, ...]
    groups: list[Group]
    custom: list[tuple[int, int, Barrier]]
    scene: Scene
    reaches: list[list[Reach]]
    turns: bool
    priority: Integers
    least: Array
    share: Array

    @property
    def entries(self) -> list[tuple[int, int, Barrier]]:
        """Scene, place and barrier of functions and of users' own classes."""
        functions = [
            (int(i), int(k), self.scenes[i][k])
            for group in self.groups
            for i in group.scenes
            for k in group.places
        ]
        return self.custom + functions

    def margins(self, margin: float) -> Array:
        """Return (N, m) what each row reserves between h and zero."""
        return self.least + margin * self.share

    def is_of(self, scenes: Sequence[Conditions]) -> bool:
        """Return whether scenes hold these very barriers."""
        return len(self.scenes) == len(scenes) and all(
            a is b or (len(a) == len(b) and all(map(operator.is_, a, b)))
            for a, b in zip(self.scenes, scenes, strict=True)
        )


def prepared(
    scenes: BarrierSet, functions: FunctionCache, reach: Callable[[Barrier], Reach]
) -> Prepared:
    """Return what is known of the barriers of N scenes.

    Raises:
        InvalidInputError: if no input reaches one.
    """
    listed: Any = scenes.listed
    distinct = listed[:1] if all(one is listed[0] for one in listed) else listed
    groups = functions.groups(listed)
    of_functions = {
        (int(i), int(k)): one
        for group in groups
        for i in group.scenes[: len(distinct)]
        for k, one in zip(group.places, group.kernel.reaches, strict=True)
    }
    reaches = [
        [of_functions.get((i, k)) or reach(barrier) for k, barrier in enumerate(scene)]
        for i, scene in enumerate(distinct)
    ]
    kind, degree = scenes.kind.copy(), np.zeros_like(scenes.kind)
    for row, of_scene in zip(degree, reaches, strict=False):
        row[: len(of_scene)] = [one.degree for one in of_scene]
    degree[len(distinct) :] = degree[:1]
    custom = []
    for (i, k), barrier in sorted(scenes.own.items(), key=itemgetter(0)):
        if isinstance(barrier, Function):
            kind[i, k] = ELSEWHERE
        else:
            custom.append((i, k, barrier))
    return Prepared(
        tuple(listed),
        groups,
        custom,
        Scene(kind, scenes.parameters, degree),
        reaches,
        bool((degree[kind != ELSEWHERE] == 2).any()),
        scenes.priority,
        scenes.own_margin,
        scenes.keeps_margin,
    )
