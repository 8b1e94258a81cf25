"""The barriers of one scene, or of N scenes, as arrays that the compiled kernels read."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, Jet, checked, reads_time
from hcbf_gym.barriers.many import Element, Flat, Shapes, each, is_list
from hcbf_gym.barriers.mapped import Atlas, Mapped
from hcbf_gym.barriers.shape import Shape
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, count, instance, shown

_ARRAYS = "kind", "parameters", "priority", "keeps_margin", "own_margin", "ends"
_IN_EMPTY_PLACES = {"kind": layout.NONE, "ends": np.inf}  # all other arrays are 0 there
_SHAPES = set(SHAPES)


class Condition(NamedTuple):
    """The barrier of a row of a report: its name, and its rank, of which 1 is strict."""

    name: str
    rank: int


class BarrierSet:
    """m barriers in each of N scenes, evaluated for N states of the double integrator at once.

    A user's own `Barrier` is evaluated in Python, by one call of its `batch` for all scenes that
    share the object, which takes some 30 µs. A scene may be empty, and may have no barrier of some
    rank. A scene with fewer than m barriers ends with places of the kind `layout.NONE`.

    Args:
        scenes: N sequences of elements.
        before: a set that is not used any more. Its pieces of maps are continued, see `Atlas`.
        is_placed: whether shapes are given as of time 0 of the plant's clock, as an environment
            does that sets its scenes here. A filter then reads these arrays without a copy.

    Raises:
        InvalidInputError: if an element is no barrier, or `Shapes` are of another number of plants.

    Attributes:
        kind: (N, m) the kinds of the barriers, see `layout`.
        parameters: (N, m, 19) the blocks of the barriers, see `layout`.
        priority: (N, m) 1 is the highest and strict; 0 in a place without a barrier.
        keeps_margin: (N, m) 1 for strict barriers on the position, 0 for the others.
        own_margin: (N, m) the margins that barriers have themselves: those of speed limits [m/s]
            and of a map's regions [m]; 0 for the others.
        ends: (N, m) for how long regions go on moving [s]; in a filter, the time at which they end.
        version: (N,) how often each scene was set.
        edits: how often a scene was set, all scenes together.
        own: (scene, place) → a user's own barrier; empty where all are built in.
        listed: N sequences, the barriers one by one.
        atlas: the pieces of maps.
    """

    def __init__(
        self,
        scenes: Sequence[Sequence[Element]],
        before: "BarrierSet | None" = None,
        is_placed: bool = False,
    ):
        if not is_list(scenes):
            raise InvalidInputError(f"barrier set: got {shown(scenes)}, expected N sequences")
        if before is not None:
            instance("before", before, BarrierSet)
        self.is_placed = is_placed
        are_one = len(scenes) > 1 and all(scene is scenes[0] for scene in scenes)
        listed = [each(scene) for scene in (scenes[:1] if are_one else scenes)]
        shape = len(scenes), max(map(_length, listed), default=0)
        self.kind = np.full(shape, layout.NONE)
        self.parameters = np.zeros((*shape, layout.WIDTH))
        self.priority = np.zeros(shape, dtype=np.int64)
        self.keeps_margin = np.zeros(shape)
        self.own_margin = np.zeros(shape)
        self.ends = np.full(shape, np.inf)
        self.version = np.zeros(len(scenes), dtype=np.int64)
        self.edits = 0
        self.own: dict[tuple[int, int], Barrier] = {}
        self.atlas = Atlas(None if before is None else before.atlas)
        self.listed: list[Flat] = [()] * len(scenes)
        for i, scene_barriers in enumerate(listed):
            self._set(i, scene_barriers)
        if are_one:
            self._repeat_scene_0()

    def set_scene(self, i: int, scene: Sequence[Element]) -> None:
        """Replace the barriers of scene `i`.

        Raises:
            InvalidInputError: if there are more than m of them, or an element is no barrier.
        """
        i = count("scene", i, minimum=0, maximum=len(self.kind) - 1)
        listed, m = each(scene), self.kind.shape[1]
        length = _length(listed)
        if length > m:
            raise InvalidInputError(
                f"barrier set: got a scene of {length} barriers, expected at most {m}"
            )
        for barrier_at in (self.own, self.atlas.held):
            for k in range(m) if barrier_at else ():
                barrier_at.pop((i, k), None)
        for name in _ARRAYS:
            getattr(self, name)[i] = _IN_EMPTY_PLACES.get(name, 0)
        self._set(i, listed)

    def changed(self, i: int) -> None:
        """Count a change of scene `i`, whose arrays were written to."""
        self.version[i] += 1
        self.edits += 1

    def _set(self, i: int, listed: Flat) -> None:
        """Write the barriers of scene `i`, which is empty."""
        self.changed(i)
        self.listed[i] = listed
        place = 0
        for cls, group in groupby(listed, type):
            barriers = list(group)
            if cls in _SHAPES:
                place = self._set_shapes(i, place, cls, barriers)
                continue
            for barrier in barriers:
                place = self._set_other(i, place, barrier)

    def _set_shapes(self, i: int, place: int, cls: type[Shape], shapes: list[Any]) -> int:
        """Write shapes of one class at once; return the place behind the last."""
        end = place + len(shapes)
        ranks = np.array([shape.priority for shape in shapes])
        self.kind[i, place:end] = cls.code
        self.parameters[i, place:end] = cls.blocks_of(shapes)
        self.priority[i, place:end] = ranks
        self.keeps_margin[i, place:end] = ranks == 1
        return end

    def _repeat_scene_0(self) -> None:
        """Copy scene 0 to all others, except for numbers that `Shapes` have for each plant."""
        others = range(1, len(self.kind))
        for name in (*_ARRAYS, "version"):
            array = getattr(self, name)
            array[1:] = array[0]
        self.listed = self.listed[:1] * len(self.kind)
        for barrier_at in (self.own, self.atlas.held):
            in_scene_0: list[Any] = list(barrier_at.items())
            barrier_at.update({(i, k): barrier for (_, k), barrier in in_scene_0 for i in others})
        for barrier, k, end in places_of(self.listed[0]):
            if isinstance(barrier, Shapes) and barrier.parameters.ndim == 3:
                self.parameters[:, k:end] = barrier.parameters
                self.ends[:, k:end] = barrier.moves_for

    def _set_other(self, i: int, k: int, barrier: Barrier | Shapes) -> int:
        """Write a barrier that is no single built-in shape; return the place behind it."""
        end = k + (len(barrier) if isinstance(barrier, Shapes) else 1)
        self.priority[i, k:end] = barrier.priority
        self.keeps_margin[i, k:end] = barrier.priority == 1 and barrier.reads_position
        if isinstance(barrier, Shapes):
            self.kind[i, k:end] = barrier.kind
            self.parameters[i, k:end] = barrier.of_plant(i, len(self.kind))
            is_shared = barrier.parameters.ndim == 2
            self.ends[i, k:end] = barrier.moves_for if is_shared else barrier.moves_for[i]
            return end
        if isinstance(barrier, SpeedLimit):
            self.own_margin[i, k] = barrier.margin
        if type(barrier) is SpeedLimit:
            self.kind[i, k] = barrier.write(self.parameters[i, k])
        elif isinstance(barrier, Mapped):
            self.atlas.hold((i, k), barrier, self.parameters)
            self.kind[i, k] = barrier.code
            if barrier.reads_position:
                self.own_margin[i, k] = barrier.margin
        else:
            self.own[i, k] = barrier
            self.kind[i, k] = layout.CUSTOM
        return end

    @property
    def is_region(self) -> Mask:
        """(N, m) whether a barrier is a built-in shape."""
        return self.kind < layout.SPEED_LIMIT

    def depends_on_time(self, n: int) -> bool:
        """Return whether a barrier depends on time; users' own are sampled at states (n,)."""
        velocity = self.parameters[self.is_region][:, [layout.VELOCITY_X, layout.VELOCITY_Y]]
        own = {id(barrier): barrier for barrier in self.own.values()}.values()
        return bool(velocity.any()) or any(reads_time(barrier, n) for barrier in own)

    def conditions(self, i: int = 0) -> list[Condition]:
        """Return the conditions of scene `i` in the order of rows; an empty place is "nothing"."""
        names = [
            barrier.name for barrier, k, end in places_of(self.listed[i]) for _ in range(k, end)
        ]
        ranks = self.priority[i].tolist()
        names += ["nothing"] * (len(ranks) - len(names))
        return [Condition(*pair) for pair in zip(names, ranks, strict=True)]

    def of(self, mask: Mask) -> "BarrierSet":
        """Return a set of the masked scenes (N,), which is this one if all are masked."""
        if mask.all():
            return self
        chosen = BarrierSet([()] * int(mask.sum()), is_placed=self.is_placed)
        for name in (*_ARRAYS, "version"):
            setattr(chosen, name, getattr(self, name)[mask])
        new_index = {int(i): position for position, i in enumerate(np.flatnonzero(mask))}
        chosen.listed = [self.listed[i] for i in new_index]
        chosen.own = {
            (new_index[i], k): barrier for (i, k), barrier in self.own.items() if i in new_index
        }
        chosen.atlas = self.atlas.of_scenes(new_index)
        return chosen

    def values(self, x: Array, t: Array) -> Array:
        """Return h (N, m) at the states x (N, 4) and times t (N,)."""
        h = np.empty(self.kind.shape)
        _core.barrier_values(self.kind, self.parameters, self.atlas.numbers, x, t, h)
        self.write_own_values(x, t, h)
        return h

    def write_own_values(self, x: Array, t: Array, h: Array) -> None:
        """Write into h (N, m) the values of users' own barriers."""
        for scenes, k, barrier in self._shared():
            h[scenes, k] = _jets(barrier, x[scenes], t[scenes]).h

    def along(self, x: Array, t: Array) -> Array:
        """Return h (k, m) of scene 0 at k states x (k, 4) and times t (k,)."""
        h = np.empty((len(x), self.kind.shape[1]))
        kind, parameters = self.kind[:1], self.parameters[:1]
        _core.barrier_values(kind, parameters, self.atlas.numbers, x, t, h)
        for (i, k), barrier in self.own.items():
            if i == 0:
                h[:, k] = _jets(barrier, x, t).h
        return h

    def sense(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return h (N, m) and (N, m, 4) what a policy sees: h, unit gradient, ∂h/∂t.

        The gradient is that in the position. Where it is 0, ∂h/∂t is reported as 0, too.
        """
        h, sensed = np.empty(self.kind.shape), np.empty((*self.kind.shape, 4))
        _core.barrier_sense(self.kind, self.parameters, self.atlas.numbers, x, t, h, sensed)
        for scenes, k, barrier in self._shared():
            jet = _jets(barrier, x[scenes], t[scenes])
            h[scenes, k] = jet.h
            sensed[scenes, k] = _sensed(jet)
        return h, sensed

    def _shared(self) -> Iterator[tuple[list[int], int, Barrier]]:
        """Yield the scenes that share a user's own barrier at one place, the place, and it."""
        sharing: dict[tuple[int, int], tuple[list[int], int, Barrier]] = {}
        for (i, k), barrier in self.own.items():
            sharing.setdefault((id(barrier), k), ([], k, barrier))[0].append(i)
        yield from sharing.values()


def places_of(listed: Flat) -> Iterator[tuple[Barrier | Shapes, int, int]]:
    """Yield the barriers of a scene, each with its first place and the place behind its last."""
    place = 0
    for barrier in listed:
        end = place + (len(barrier) if isinstance(barrier, Shapes) else 1)
        yield barrier, place, end
        place = end


def _length(listed: Flat) -> int:
    """Return the number of rows that the barriers of a scene have."""
    return sum(len(barrier) if isinstance(barrier, Shapes) else 1 for barrier in listed)


def _jets(barrier: Barrier, x: Array, t: Array) -> Jet:
    """Return the jets of a user's own barrier at states x (N, 4) and times t (N,)."""
    return checked(barrier, barrier.batch(x, t), x.shape[1], finite=False, count=len(x))


def _sensed(jet: Jet) -> Array:
    """Return (N, 4) what a policy sees of N jets, see `BarrierSet.sense`."""
    gradient = jet.gradient[:, :2]
    norm = np.linalg.norm(gradient, axis=1)[:, None]
    unit = np.divide(gradient, norm, out=np.zeros_like(gradient), where=norm > 0.0)
    return np.column_stack([jet.h, unit, np.where(norm[:, 0] > 0.0, jet.rate, 0.0)])
