"""The barriers of N scenes of any model, with what stays the same from state to state."""

import itertools
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache, SeparateRows
from hcbf_gym.barriers.function_rows import FunctionRows
from hcbf_gym.barriers.layout import ELSEWHERE
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit

Conditions = tuple[Barrier, ...]


class Scene(NamedTuple):
    """The barriers of N scenes, as compiled code reads them."""

    kind: Integers  # (N, m) as `layout` has it, `NONE` behind a shorter scene; or `ELSEWHERE`
    parameters: Array  # (N, m, WIDTH) the blocks of built-in ones
    degree: Integers  # (N, m) the derivative of h that an input enters first, 1 or 2


class Group(NamedTuple):
    """Functions of the same signatures, at the same places of some scenes."""

    scenes: Integers  # (K,) which of N
    places: Integers  # (k,) of m
    rows: FunctionRows | SeparateRows


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
    scenes: Sequence[Conditions], functions: FunctionCache, reach: Callable[[Barrier], Reach]
) -> Prepared:
    """Return what is known of the barriers of N scenes.

    Raises:
        InvalidInputError: if no input reaches one.
    """
    count = len(scenes)
    if count > 1 and all(scene is scenes[0] for scene in scenes):
        return _repeated(prepared(scenes[:1], functions, reach), count, functions)
    groups = _groups(scenes, functions)
    of_functions = {
        (int(i), int(k)): one
        for group in groups
        for i in group.scenes
        for k, one in zip(group.places, group.rows.reaches, strict=True)
    }
    reaches = [
        [of_functions.get((i, k)) or reach(barrier) for k, barrier in enumerate(scene)]
        for i, scene in enumerate(scenes)
    ]
    kind, parameters = _blocks(scenes)

    def filled(of: Callable[[Barrier], float], dtype: DTypeLike) -> Any:
        return _filled([[of(barrier) for barrier in scene] for scene in scenes], kind.shape, dtype)

    degree = _filled([[one.degree for one in scene] for scene in reaches], kind.shape, np.int64)
    return Prepared(
        tuple(scenes),
        groups,
        [(int(i), int(k), scenes[i][k]) for i, k in np.argwhere(kind == layout.CUSTOM)],
        Scene(kind, parameters, degree),
        reaches,
        bool((degree[kind != ELSEWHERE] == 2).any()),
        filled(lambda one: one.priority, np.int64),
        filled(lambda one: one.margin if isinstance(one, SpeedLimit) else 0.0, np.float64),
        filled(lambda one: one.priority == 1 and one.reads_position, np.float64),
    )


def _repeated(one: Prepared, count: int, functions: FunctionCache) -> Prepared:
    """Return what is known of N scenes that are the same."""

    def repeated(part: Any) -> Any:
        return np.repeat(part, count, axis=0)

    scenes = one.scenes * count
    return one._replace(
        scenes=scenes,
        groups=_groups(scenes, functions) if one.groups else [],
        custom=[(i, k, barrier) for i in range(count) for _, k, barrier in one.custom],
        scene=Scene(*map(repeated, one.scene)),
        priority=repeated(one.priority),
        least=repeated(one.least),
        share=repeated(one.share),
    )


def _groups(scenes: Sequence[Conditions], functions: FunctionCache) -> list[Group]:
    """Return the functions of N scenes, those of the same signatures together."""
    found: dict[tuple[tuple[int, ...], tuple[object, ...]], list[tuple[int, list[Function]]]] = {}
    for i, scene in enumerate(scenes):
        there = [(k, one) for k, one in enumerate(scene) if isinstance(one, Function)]
        if there:
            key = tuple(k for k, _ in there), tuple(one.signature for _, one in there)
            found.setdefault(key, []).append((i, [one for _, one in there]))
    return [
        Group(
            np.array([i for i, _ in members]),
            np.array(places),
            functions.rows([of_scene for _, of_scene in members]),
        )
        for (places, _), members in found.items()
    ]


def _filled(lists: Sequence[Sequence[float]], shape: tuple[int, ...], dtype: DTypeLike) -> Any:
    """Return N lists of at most m numbers as an array (N, m), zero behind the shorter ones."""
    filled = np.zeros(shape, dtype=dtype)
    for row, numbers in zip(filled, lists, strict=True):
        row[: len(numbers)] = numbers
    return filled


def _blocks(scenes: Sequence[Conditions]) -> tuple[Integers, Array]:
    """Return kinds (N, m) and blocks (N, m, WIDTH) of N scenes."""
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
