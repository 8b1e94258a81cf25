"""The barriers of N scenes, with what stays the same from state to state."""

import itertools
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import SeparateRows
from hcbf_gym.barriers.function_rows import FunctionRows
from hcbf_gym.barriers.general_kernels import ELSEWHERE, Scene
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit


class Group(NamedTuple):
    """Functions of the same signatures, at the same places of some scenes.

    Attributes:
        scenes: (K,) which of N scenes.
        places: (k,) of m.
        rows: what makes their rows.
    """

    scenes: Integers
    places: Integers
    rows: FunctionRows | SeparateRows


class Prepared(NamedTuple):
    """The barriers of N scenes, with what stays the same from state to state.

    Attributes:
        scenes: N tuples of at most m of them; behind a shorter one there is no row.
        groups: those that are functions.
        custom: scene, place and barrier of users' own classes.
        scene: the others, as compiled code reads them.
        reaches: how inputs reach the barriers of each scene, of the first alone where all are one.
        turns: whether an input enters the second derivative of a barrier that is no function.
        priority: (N, m), 0 where there is no row.
        least: (N, m) what a row reserves by itself: a speed limit's margin.
        share: (N, m) how much of a margin on the position a row reserves.
    """

    scenes: tuple[tuple[Barrier, ...], ...]
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


def are_same(one: Sequence[tuple[object, ...]], other: Sequence[tuple[object, ...]]) -> bool:
    """Return whether scenes hold the very same barriers."""
    return all(
        a is b or (len(a) == len(b) and all(map(operator.is_, a, b)))
        for a, b in zip(one, other, strict=True)
    )


def function_at(scene: tuple[Barrier, ...], k: int) -> Function:
    """Return the function at a place of a scene."""
    barrier = scene[k]
    assert isinstance(barrier, Function)
    return barrier


def margins(barriers: Sequence[Barrier], margin: ArrayLike) -> Array:
    """Return (m,) what each row reserves between h and zero.

    Args:
        barriers: m safety conditions.
        margin: (m,), or one number for the rows of priority 1 that read the position; a speed
            limit then reserves its own.
    """
    given = np.asarray(margin, dtype=np.float64)
    if given.ndim:
        return given
    return np.array(
        [
            barrier.margin
            if isinstance(barrier, SpeedLimit)
            else float(given) * (barrier.priority == 1 and barrier.reads_position)
            for barrier in barriers
        ]
    )


def filled(lists: Sequence[Sequence[float]], shape: tuple[int, ...], dtype: DTypeLike) -> Any:
    """Return N lists of at most m numbers as an array (N, m), zero behind the shorter ones."""
    filled = np.zeros(shape, dtype=dtype)
    for row, numbers in zip(filled, lists, strict=True):
        row[: len(numbers)] = numbers
    return filled


def blocks(scenes: Sequence[tuple[Barrier, ...]]) -> tuple[Integers, Array]:
    """Return kinds (N, m) and blocks (N, m, WIDTH) of N scenes, as compiled code reads them."""
    kind = np.full((len(scenes), max(map(len, scenes))), layout.NONE, dtype=np.int64)
    parameters = np.zeros((*kind.shape, layout.WIDTH))
    for i, scene in enumerate(scenes):
        kind[i, : len(scene)] = ELSEWHERE
        k = 0
        for cls, run in itertools.groupby(scene, type):
            barriers: list[Any] = list(run)
            end = k + len(barriers)
            if cls in SHAPES:
                kind[i, k:end] = cls.code
                parameters[i, k:end] = cls.blocks_of(barriers)
            elif cls is SpeedLimit:
                for place, barrier in enumerate(barriers, k):
                    kind[i, place] = barrier.write(parameters[i, place])
            elif not issubclass(cls, Function):
                kind[i, k:end] = layout.CUSTOM
            k = end
    return kind, parameters
