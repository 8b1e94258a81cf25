"""The barriers of one scene, or of N scenes, as arrays that the compiled kernels read."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, Jet, reads_time
from hcbf_gym.barriers.many import Element, Flat, Shapes, each, is_list
from hcbf_gym.barriers.mapped import Atlas, Mapped
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, count, instance, shown

_ARRAYS = "kind", "parameters", "priority", "keeps_margin", "own_margin", "ends"
_EMPTY = {"kind": layout.NONE, "ends": np.inf}
_SHAPES = set(SHAPES)


class Condition(NamedTuple):
    """The name and the rank of the barrier of a report's row; 1 is the highest and strict."""

    name: str
    rank: int


class BarrierSet:
    """m barriers in each of N scenes, evaluated for N states of the double integrator at once.

    A user's own `Barrier` is evaluated in Python, by one call of its `batch` for all scenes that
    share the object, some 30 µs. A scene may leave ranks out, such as those of obstacles that are
    not in sight, and may be empty. One that is shorter than the longest, m, ends with places of the
    kind `layout.NONE`.

    Args:
        scenes: N sequences of elements.
        before: a set that is no longer set, whose pieces of maps stay where they are.
        is_placed: whether shapes are where they are at time 0 of the plant's clock, as those of an
            environment that sets its scenes here; its filter then reads these very arrays.

    Raises:
        InvalidInputError: if an element is no barrier, or `Shapes` of so many plants are in a set
            of another number.

    Attributes:
        kind: (N, m) of the barriers, see `layout`.
        parameters: (N, m, 19) what compiled code reads, see `layout`.
        priority: (N, m) 1 is the highest and strict; 0 of no barrier.
        keeps_margin: (N, m) 1 for strict barriers on the position, 0 for the others.
        own_margin: (N, m) what a speed limit reserves itself [m/s], 0 for the others.
        ends: (N, m) for how long regions go on moving [s]; of a filter, until when.
        version: (N,) how often each scene was set.
        edits: how often any was.
        own: (scene, place) → a user's own barrier; empty where all are built in.
        listed: N sequences, the barriers one by one.
        atlas: where the pieces of maps are.
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
        same = len(scenes) > 1 and all(scene is scenes[0] for scene in scenes)
        listed = [each(scene) for scene in (scenes[:1] if same else scenes)]
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
        for i, one in enumerate(listed):
            self._set(i, one)
        if same:
            self._repeat()

    def set_scene(self, i: int, scene: Sequence[Element]) -> None:
        """Replace the barriers of scene `i`.

        Raises:
            InvalidInputError: if there are more than m of them, or an element is no barrier.
        """
        i = count("scene", i, minimum=0, maximum=len(self.kind) - 1)
        listed, m = each(scene), self.kind.shape[1]
        given = _length(listed)
        if given > m:
            raise InvalidInputError(
                f"barrier set: got a scene of {given} barriers, expected at most {m}"
            )
        for places in (self.own, self.atlas.held):
            for k in range(m) if places else ():
                places.pop((i, k), None)
        for name in _ARRAYS:
            getattr(self, name)[i] = _EMPTY.get(name, 0)
        self._set(i, listed)

    def changed(self, i: int) -> None:
        """Note that the arrays of scene `i` were written to."""
        self.version[i] += 1
        self.edits += 1

    def _set(self, i: int, listed: Flat) -> None:
        """Write the barriers of scene `i`, which is empty."""
        self.changed(i)
        self.listed[i] = listed
        k = 0
        for cls, run in ((cls, list(run)) for cls, run in groupby(listed, type)):
            if cls in _SHAPES:
                end = k + len(run)
                self.kind[i, k:end] = cls.code
                self.parameters[i, k:end] = cls.blocks_of(run)
                self.priority[i, k:end] = ranks = np.array([one.priority for one in run])
                self.keeps_margin[i, k:end] = ranks == 1
                k = end
                continue
            for barrier in run:
                k = self._set_one(i, k, barrier)

    def _repeat(self) -> None:
        """Let all scenes be like scene 0, but for what `Shapes` have of each plant."""
        everywhere = range(1, len(self.kind))
        for name in (*_ARRAYS, "version"):
            array = getattr(self, name)
            array[1:] = array[0]
        self.listed = self.listed[:1] * len(self.kind)
        for places in (self.own, self.atlas.held):
            there: list[Any] = list(places.items())
            places.update({(i, k): one for (_, k), one in there for i in everywhere})
        for one, k, end in places_of(self.listed[0]):
            if isinstance(one, Shapes) and one.parameters.ndim == 3:
                self.parameters[:, k:end] = one.parameters
                self.ends[:, k:end] = one.moves_for

    def _set_one(self, i: int, k: int, barrier: Barrier | Shapes) -> int:
        """Put a barrier that is no built-in shape at (scene, place); return the place behind it."""
        end = k + (len(barrier) if isinstance(barrier, Shapes) else 1)
        self.priority[i, k:end] = barrier.priority
        self.keeps_margin[i, k:end] = barrier.priority == 1 and barrier.reads_position
        if isinstance(barrier, Shapes):
            self.kind[i, k:end] = barrier.kind
            self.parameters[i, k:end] = barrier.of_plant(i, len(self.kind))
            self.ends[i, k:end] = (
                barrier.moves_for if barrier.parameters.ndim == 2 else barrier.moves_for[i]
            )
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
        """(N, m) whether a barrier is a built-in one on the position."""
        return self.kind < layout.SPEED_LIMIT

    @property
    def moves(self) -> Mask:
        """(N,) whether a scene depends on time, as far as `reads_time` shows it."""
        velocity = self.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]]
        moving = (self.is_region[..., None] & (velocity != 0.0)).any(axis=(1, 2))
        for (i, _), barrier in self.own.items():
            moving[i] = moving[i] or reads_time(barrier, 4)
        return moving

    def conditions(self, i: int = 0) -> list[Condition]:
        """Return the conditions of scene `i`, in the order of rows; empty places are "nothing"."""
        names = [
            barrier.name for barrier, k, end in places_of(self.listed[i]) for _ in range(k, end)
        ]
        ranks = self.priority[i].tolist()
        names += ["nothing"] * (len(ranks) - len(names))
        return [Condition(*pair) for pair in zip(names, ranks, strict=True)]

    def of(self, mask: Mask) -> "BarrierSet":
        """Return the masked scenes (N,), as a set of their own; this one where all are."""
        if mask.all():
            return self
        chosen = BarrierSet([()] * int(mask.sum()), is_placed=self.is_placed)
        for name in (*_ARRAYS, "version"):
            setattr(chosen, name, getattr(self, name)[mask])
        places = {int(i): place for place, i in enumerate(np.flatnonzero(mask))}
        chosen.listed = [self.listed[i] for i in places]
        chosen.own = {(places[i], k): own for (i, k), own in self.own.items() if i in places}
        chosen.atlas = self.atlas.of(places)
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
            h[scenes, k] = barrier.batch(x[scenes], t[scenes]).h

    def along(self, x: Array, t: Array) -> Array:
        """Return h (k, m) of scene 0 at k states x (k, 4) and times t (k,)."""
        h = np.empty((len(x), self.kind.shape[1]))
        kind, parameters = self.kind[:1], self.parameters[:1]
        _core.barrier_values(kind, parameters, self.atlas.numbers, x, t, h)
        for (i, k), barrier in self.own.items():
            if i == 0:
                h[:, k] = barrier.batch(x, t).h
        return h

    def sense(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return h (N, m) and (N, m, 4) what a policy sees: h, unit gradient, ∂h/∂t.

        The gradient is that in the position; where it is 0, three zeros follow h.
        """
        h, sensed = np.empty(self.kind.shape), np.empty((*self.kind.shape, 4))
        _core.barrier_sense(self.kind, self.parameters, self.atlas.numbers, x, t, h, sensed)
        for scenes, k, barrier in self._shared():
            jet = barrier.batch(x[scenes], t[scenes])
            h[scenes, k] = jet.h
            sensed[scenes, k] = _seen(jet)
        return h, sensed

    def _shared(self) -> Iterator[tuple[list[int], int, Barrier]]:
        """Yield each user's own barrier with its place, and the scenes that share the object."""
        groups: dict[tuple[int, int], tuple[list[int], int, Barrier]] = {}
        for (i, k), barrier in self.own.items():
            groups.setdefault((id(barrier), k), ([], k, barrier))[0].append(i)
        yield from groups.values()


def places_of(listed: Flat) -> Iterator[tuple[Barrier | Shapes, int, int]]:
    """Yield the barriers of a scene, each with its first place and the place behind its last."""
    k = 0
    for one in listed:
        end = k + (len(one) if isinstance(one, Shapes) else 1)
        yield one, k, end
        k = end


def _length(listed: Flat) -> int:
    """Return how many rows the barriers of a scene have."""
    return sum(len(one) if isinstance(one, Shapes) else 1 for one in listed)


def _seen(jet: Jet) -> Array:
    """Return (N, 4) h, the unit gradient in the position, ∂h/∂t."""
    gradient = jet.gradient[:, :2]
    norm = np.linalg.norm(gradient, axis=1)[:, None]
    unit = np.divide(gradient, norm, out=np.zeros_like(gradient), where=norm > 0.0)
    return np.column_stack([jet.h, unit, np.where(norm[:, 0] > 0.0, jet.rate, 0.0)])
