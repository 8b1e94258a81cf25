"""Scenes for any model: all that rows need and that stays the same from state to state."""

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache
from hcbf_gym.barriers.function_group import Group
from hcbf_gym.barriers.layout import ELSEWHERE
from hcbf_gym.barriers.many import are_same
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry

Conditions = tuple[Barrier, ...]


class Prepared(NamedTuple):
    """The barriers of N scenes, and all that does not depend on the state."""

    barrier_set: BarrierSet  # of N scenes; `priority` is 0 where a shorter scene has no row
    kind: Integers  # (N, m) as in `layout`; `ELSEWHERE` for functions
    degree: Integers  # (N, m) the derivative of h that an input enters first
    groups: list[Group]  # the functions among the barriers
    custom: list[Entry]  # the barriers of users' own classes, which have a `jet`
    reaches: list[list[Reach]]  # by scene and barrier; of one scene if all scenes are the same
    needs_jacobian: bool  # whether rows need ∂f/∂x: a barrier that is no function has degree 2

    @property
    def built_in(self) -> tuple[Integers, Array, Integers]:
        """Kind (N, m), parameters (N, m, WIDTH) and degree (N, m), which compiled code reads."""
        return self.kind, self.barrier_set.parameters, self.degree

    @property
    def entries(self) -> list[Entry]:
        """All barriers that Python evaluates: those of users' own classes, then the functions."""
        listed: Any = self.barrier_set.listed
        functions = [
            Entry(int(i), int(k), listed[i][k])
            for group in self.groups
            for i in group.scene_indices
            for k in group.places
        ]
        return self.custom + functions

    def margins(self, margin: float) -> Array:
        """Return (N, m) each barrier's own margin, and `margin` of strict ones on the position."""
        return self.barrier_set.own_margin + margin * self.barrier_set.keeps_margin

    def is_of(self, scenes: Sequence[Conditions]) -> bool:
        """Return whether N scenes hold the same barrier objects as those that were prepared."""
        listed = self.barrier_set.listed
        return len(listed) == len(scenes) and all(map(are_same, listed, scenes))


def prepare_scenes(
    barrier_set: BarrierSet, functions: FunctionCache, reach: Callable[[Barrier], Reach]
) -> Prepared:
    """Return N scenes with how inputs reach their barriers, and with groups of functions.

    Args:
        barrier_set: the scenes of N plants.
        functions: compiles the rows of functions.
        reach: returns how inputs reach a barrier that is no function, and raises an
            InvalidInputError if none does.
    """
    listed: Any = barrier_set.listed
    are_one = all(scene is listed[0] for scene in listed)
    distinct = listed[:1] if are_one else listed
    groups = functions.groups(listed)
    function_reaches: dict[tuple[int, int], Reach] = {}
    for group in groups:
        for i in group.scene_indices[: len(distinct)].tolist():
            for k, function_reach in zip(group.places, group.kernel.reaches, strict=True):
                function_reaches[i, int(k)] = function_reach
    reaches = [
        [function_reaches.get((i, k)) or reach(barrier) for k, barrier in enumerate(scene)]
        for i, scene in enumerate(distinct)
    ]
    kind, degree = barrier_set.kind.copy(), np.zeros_like(barrier_set.kind)
    for i, scene_reaches in enumerate(reaches):
        degree[i, : len(scene_reaches)] = [one.degree for one in scene_reaches]
    if are_one:
        degree[1:] = degree[:1]
    custom = []
    for (i, k), barrier in sorted(barrier_set.own.items(), key=itemgetter(0)):
        if isinstance(barrier, Function):
            kind[i, k] = ELSEWHERE
        else:
            custom.append(Entry(i, k, barrier))
    needs_jacobian = bool((degree[kind != ELSEWHERE] == 2).any())
    return Prepared(barrier_set, kind, degree, groups, custom, reaches, needs_jacobian)
