"""The barriers of one scene, or of N scenes, as arrays that the compiled kernels read."""

import operator
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout, margins, zone
from hcbf_gym.barriers.atlas import Atlas
from hcbf_gym.barriers.barrier import Barrier, Jet, reads_time
from hcbf_gym.barriers.general_kernels import WIDTH
from hcbf_gym.barriers.many import Several, Shapes
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.own_rows import write_own_row
from hcbf_gym.barriers.rows import ALPHA2_PSI, B, CbfRows, H, RowSettings
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit, check_leaves_speed
from hcbf_gym.errors import InvalidInputError, count, instance, shown
from hcbf_gym.models.plant import Uncertainty

Entry = Barrier | Shapes | Several

_Read = list[tuple[Several, tuple[Barrier, ...]]]
"""Entries of a scene that stand for several barriers, and those for which they stood."""

_ARRAYS = ("kind", "parameters", "priority", "keeps_margin", "own_margin")
_SHAPES = set(SHAPES)
_BUILT_IN = {*SHAPES, SpeedLimit}  # a user's own class may derive from one and change it


class Condition(NamedTuple):
    """What a row of a report stands for.

    Attributes:
        name: of the barrier.
        rank: its priority; 1 is the highest and strict.
    """

    name: str
    rank: int


class BarrierSet:
    """m barriers in each of N scenes, evaluated for N states of the double integrator at once.

    Built-in shapes are evaluated compiled. A user's own `Barrier` is evaluated in Python, by one
    call of its `batch` for all scenes that share the object; that costs some 30 µs a call.

    A scene may leave ranks out, such as those of obstacles that are not in sight, and may be empty.

    Args:
        scenes: N sequences of m barriers; `Shapes` and what is `Several` count as so many.
        before: a set that nobody sets any more, whose pieces of maps stay where they stand.
        since: the plant's time at which shapes are where they are put [s]; None is the time at
            which a filter first sees a scene.
        fills: whether scenes may be shorter than the longest one, m; they end with places of the
            kind `layout.NONE`, which have no row.

    Raises:
        InvalidInputError: if the scenes differ in length and are not filled, or an entry is no
            `Barrier`.

    Attributes:
        kind: (N, m) which kernel evaluates the barrier, see `layout`.
        parameters: (N, m, 19) what that kernel reads, see `layout`.
        priority: (N, m) 1 is the highest and strict; 0 of no barrier.
        keeps_margin: (N, m) 1 for strict barriers on the position, 0 for the others.
        own_margin: (N, m) what a speed limit reserves by itself [m/s], 0 for the others.
        version: (N,) how often each scene was set: a filter sees by it what is news.
        edits: how often any was.
        own: (scene, place) → a user's own barrier; empty where all are built in.
        since: as given.
        is_kept: whether only its filter has it, so that its arrays stay as they are.
        entries: N sequences, what the scenes were set from; () where that were arrays.
        listed: N sequences, those barriers one by one, as they were read.
        atlas: where the pieces of maps stand.
    """

    def __init__(
        self,
        scenes: Sequence[Sequence[Entry]],
        before: "BarrierSet | None" = None,
        since: float | None = None,
        fills: bool = False,
    ):
        if not is_list(scenes):
            raise InvalidInputError(f"barrier set: got {shown(scenes)}, expected N sequences")
        if before is not None:
            instance("before", before, BarrierSet)
        self.since, self.is_kept, self._fills = since, False, fills
        shape = (len(scenes), max(map(_length, scenes), default=0))
        self.kind = np.zeros(shape, dtype=np.int64)
        self.parameters = np.zeros((*shape, layout.WIDTH))
        self.priority = np.zeros(shape, dtype=np.int64)
        self.keeps_margin = np.zeros(shape)
        self.own_margin = np.zeros(shape)
        self.version = np.zeros(len(scenes), dtype=np.int64)
        self.edits = 0
        self.own: dict[tuple[int, int], Barrier] = {}
        self.atlas = Atlas(None if before is None else before.atlas)
        self.entries: list[Sequence[Entry]] = [()] * len(scenes)
        self.listed: list[Sequence[Barrier | Shapes]] = [()] * len(scenes)
        self._read: dict[int, _Read] = {}
        for i, scene in enumerate(scenes):
            self.set_scene(i, scene)

    def set_scene(self, i: int, scene: Sequence[Entry]) -> None:
        """Replace the barriers of scene `i`.

        Raises:
            InvalidInputError: if there are not m of them, or more in a set that fills up scenes, or
                an entry is no `Barrier`.
        """
        i = count("scene", i, minimum=0, maximum=len(self.kind) - 1)
        entries: Any = _scene(scene)
        read = [
            (one, tuple(one.conditions))
            for one in entries
            if type(one) not in _BUILT_IN and isinstance(one, Several)
        ]
        barriers = entries
        if read:
            stands_for = {id(one): conditions for one, conditions in read}
            barriers = tuple(b for one in entries for b in stands_for.get(id(one), (one,)))
        runs = [(cls, list(run)) for cls, run in groupby(barriers, type)]
        given, m = sum(_count(cls, run) for cls, run in runs), self.kind.shape[1]
        if given > m or (given < m and not self._fills):
            raise InvalidInputError(f"barrier set: got a scene of {given} barriers, expected {m}")
        self.version[i] += 1
        self.edits += 1
        self.entries[i], self.listed[i] = entries, barriers
        self._read.pop(i, None)
        if read:
            self._read[i] = read
        for places in (self.own, self.atlas.held):
            for k in range(m) if places else ():
                places.pop((i, k), None)
        for array in (self.parameters, self.priority, self.keeps_margin, self.own_margin):
            array[i, given:] = 0
        self.kind[i, given:] = layout.NONE
        k = 0
        for cls, run in runs:
            if cls in _SHAPES:
                end = k + len(run)
                self.kind[i, k:end] = cls.code
                self.parameters[i, k:end] = cls.blocks_of(run)
                self.priority[i, k:end] = ranks = np.array([one.priority for one in run])
                self.keeps_margin[i, k:end], self.own_margin[i, k:end] = ranks == 1, 0.0
                k = end
                continue
            for barrier in run:
                k = self._set_one(i, k, barrier)

    def _set_one(self, i: int, k: int, barrier: Barrier | Shapes) -> int:
        """Put a barrier that is no built-in shape at (scene, place); return the place behind it."""
        end = k + (len(barrier) if isinstance(barrier, Shapes) else 1)
        self.priority[i, k:end] = barrier.priority
        self.keeps_margin[i, k:end] = barrier.priority == 1 and barrier.reads_position
        self.own_margin[i, k:end] = barrier.margin if isinstance(barrier, SpeedLimit) else 0.0
        if isinstance(barrier, Shapes):
            self.kind[i, k:end], self.parameters[i, k:end] = barrier.kind, barrier.parameters
        elif type(barrier) is SpeedLimit:
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
    def may_change(self) -> bool:
        """Whether entries stand for several barriers, which may be others by now."""
        return bool(self._read)

    def is_as_read(self) -> bool:
        """Return whether entries that stand for several barriers stand for those that were read."""
        return all(map(_stand, self._read.values()))

    def read_again(self) -> None:
        """Read what stands for several barriers and has changed in place; its scenes are news.

        Raises:
            InvalidInputError: as `set_scene` does.
        """
        for i in [i for i, read in self._read.items() if not _stand(read)]:
            self.set_scene(i, self.entries[i])

    @property
    def is_region(self) -> Mask:
        """(N, m) whether a barrier is a built-in one on the position."""
        return self.kind < layout.SPEED_LIMIT

    @property
    def moves(self) -> Mask:
        """(N,) whether a scene depends on time, as far as samples show it; see `reads_time`."""
        velocity = self.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]]
        moving = (self.is_region[..., None] & (velocity != 0.0)).any(axis=(1, 2))
        for (i, _), barrier in self.own.items():
            moving[i] = moving[i] or reads_time(barrier, 4)
        return moving

    def check(
        self, hold: tuple[float | None, float], speed_margin: float = 0.0, turn: float = 0.0
    ) -> None:
        """Refuse speed limits and speed zones that no input can satisfy.

        Args:
            hold: how long an input is held [s], None where that is not known, and the largest norm
                of an input [m/s²].
            speed_margin: what the rows of speed limits reserve besides their own margins [m/s].
            turn: the greatest turning rate of a differential drive [rad/s]; 0 for all others.

        Raises:
            InvalidInputError: if a margin leaves nothing of a speed limit, or a held input can pass
                it from rest within one period.
        """
        capped = self.kind == layout.SPEED_LIMIT
        v_max = self.parameters[capped, layout.V_MAX]
        margin = self.own_margin[capped] + speed_margin
        if len(v_max):
            worst = int(np.argmin(v_max - 2.0 * margin))
            check_leaves_speed("speed limit", v_max[worst], margin[worst])
        period, u_max = hold
        if period is None:
            return
        zones = self.kind == layout.ZONES
        limit = self.parameters[zones, layout.V_MAX]
        lowest = zone.least_limit(period, u_max, speed_margin, turn)
        if (limit < lowest).any():
            raise InvalidInputError(
                f"speed zone: got {limit.min():g} m/s, expected at least {lowest:g} m/s: its row "
                f"reserves {speed_margin:g} m/s, and an input passes the rest within one period"
            )
        gained = u_max * period
        least = np.sqrt(v_max * (v_max - 2.0 * margin)).min(initial=np.inf)
        if least <= gained:
            raise InvalidInputError(
                f"speed limit: got {least:g} m/s after its margin, expected above {gained:g} m/s, "
                "which an input reaches within one period: sample faster or allow smaller inputs"
            )

    def conditions(self, i: int = 0) -> list[Condition]:
        """Return name and rank of the barriers of scene `i`, in the order of the report's rows.

        Places that no barrier takes are called "nothing", and their rank is 0.
        """
        names = [
            barrier.name
            for barrier in self.listed[i]
            for _ in range(len(barrier) if isinstance(barrier, Shapes) else 1)
        ]
        ranks = self.priority[i].tolist()
        names = names or [f"condition {k}" for k in range(1, np.count_nonzero(ranks) + 1)]
        names += ["nothing"] * (len(ranks) - len(names))
        return [Condition(*pair) for pair in zip(names, ranks, strict=True)]

    def repeated(self, count: int) -> "BarrierSet":
        """Return `count` scenes like scene 0."""
        chosen = BarrierSet([()] * count, since=self.since)
        chosen.is_kept = self.is_kept
        for name in _ARRAYS:
            setattr(chosen, name, np.repeat(getattr(self, name)[:1], count, axis=0))
        everywhere = range(count)
        chosen.entries, chosen.listed = [self.entries[0]] * count, [self.listed[0]] * count
        chosen._read = dict.fromkeys(everywhere, self._read[0]) if self._read else {}
        chosen.own = {(i, k): own for i in everywhere for (_, k), own in self.own.items()}
        chosen.atlas = self.atlas.repeated(count)
        return chosen

    def of(self, mask: Mask) -> "BarrierSet":
        """Return the masked scenes (N,), as a set of their own; this one where all are."""
        if mask.all():
            return self
        chosen = BarrierSet([()] * int(mask.sum()), since=self.since, fills=self._fills)
        for name in (*_ARRAYS, "version"):
            setattr(chosen, name, getattr(self, name)[mask])
        places = {int(i): place for place, i in enumerate(np.flatnonzero(mask))}
        chosen.entries = [self.entries[i] for i in places]
        chosen.listed = [self.listed[i] for i in places]
        chosen._read = {places[i]: read for i, read in self._read.items() if i in places}
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
        """Write into h (N, m) the values of users' own barriers, which the kernels pass over."""
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

        The gradient is that in the position; where there is none, three zeros follow h.
        """
        h, sensed = np.empty(self.kind.shape), np.empty((*self.kind.shape, 4))
        _core.barrier_sense(self.kind, self.parameters, self.atlas.numbers, x, t, h, sensed)
        for scenes, k, barrier in self._shared():
            jet = barrier.batch(x[scenes], t[scenes])
            h[scenes, k] = jet.h
            sensed[scenes, k] = _seen(jet)
        return h, sensed

    def margins(self, margin: Array | float) -> Array:
        """Return (N, m) what each row reserves between h and zero.

        Args:
            margin: (N, m); or one number [m] for strict rows on the position, while a speed limit
                reserves its own.
        """
        given = np.asarray(margin, dtype=np.float64)
        return given if given.ndim else self.keeps_margin * given + self.own_margin

    def rows(
        self,
        x: Array,
        t: Array,
        settings: RowSettings,
        margin: Array | float = 0.0,
        margin_rate: Array | float = 0.0,
        quickening: Array | float = 0.0,
    ) -> CbfRows:
        """Return the rows of N states, each field with a leading axis N.

        Args:
            x: (N, 4) positions [m] and velocities [m/s].
            t: (N,) times [s].
            settings: α₁, α₂, and whether u is held.
            margin: (N, m) what each row reserves between h and zero; or one number, see `margins`.
            margin_rate: (N, m) its rate of change, as far as it is known.
            quickening: (N, m) the rate of that of rows on the position.
        """
        shape = self.kind.shape
        kept = np.empty((3, *shape))
        kept[0], kept[1], kept[2] = self.margins(margin), margin_rate, quickening
        a, out = np.empty((*shape, 2)), np.empty((4, *shape))
        _core.planar_rows(self.kind, self.parameters, kept, x, t, settings.packed, a, out)
        for (i, k), barrier in self.own.items():
            row = np.zeros(WIDTH + 2)
            write_own_row(barrier, x[i], float(t[i]), settings, kept[:, i, k].tolist(), row)
            a[i, k], out[:, i, k] = row[WIDTH:], row[:4]  # as `B` …
        return CbfRows(
            a,
            out[B],
            out[H],
            self.priority,
            out[ALPHA2_PSI],
        )

    def reserved(
        self,
        settings: Uncertainty,
        x: Array,
        t: Array,
        model: Array,
        lag: Array,
        covariance: Array,
        growth: Array | None = None,
        period: float = 0.0,
    ) -> Array:
        """Return (4, N, m) what the rows of N states reserve, as `margins.derive` writes it.

        Args:
            settings: the formula's numbers, d, k_v, k_p, cap, κ, ρ, d_s and k_s in this order.
            x: (N, 4) states.
            t: (N,) times [s].
            model: (N, 4) states of the reduced-order models.
            lag: (N, 4) tracking errors.
            covariance: (N, 4, 4) of the states.
            growth: (N,) g, by how much those of the velocities grow until the next sample [m²/s²];
                None for zeros.
            period: T [s]; 0 where it is not known.
        """
        out = np.zeros((4, *self.kind.shape))
        grown = np.zeros(len(x)) if growth is None else growth
        known = x, t, model, lag, covariance, grown
        _core.margins_reserved(
            np.array(settings, dtype=float), self.kind, self.parameters, *known, period, out
        )
        out[margins.MARGIN] += self.own_margin
        return out

    def nearby(
        self,
        settings: RowSettings,
        uncertainty: Uncertainty,
        radius: float,
        x: Array,
        model: Array,
        lag: Array,
        covariance: Array,
        growth: float = 0.0,
    ) -> "tuple[BarrierSet, Integers]":
        """Return scene 0 at a state, maps replaced by their nearby pieces, and (M,) what is whose.

        Args:
            settings: how rows are made.
            uncertainty: what they reserve.
            radius: the largest norm of an input [m/s²].
            x: (4,) state.
            model: (4,) the reduced-order model's own.
            lag: (4,) tracking error.
            covariance: (4, 4) of x.
            growth: by how much that of the velocity grows until the next sample [m²/s²].
        """
        scene = self.kind[0], self.parameters[0], self.priority[0], self.own_margin[0]
        atlas = np.empty(0) if self.atlas.numbers is None else self.atlas.numbers
        numbers = np.array(uncertainty, dtype=float), settings.packed, radius
        known = x, model, lag, covariance, growth
        *found, source = _core.map_nearby(*numbers, *scene, atlas, *known)
        part = BarrierSet([()])
        part.kind, part.parameters, part.priority, part.own_margin = (one[None] for one in found)
        part.keeps_margin = self.keeps_margin[:, source]
        first = [(r, int(k)) for r, k in enumerate(source)]
        part.own = {(0, r): self.own[0, k] for r, k in first if (0, k) in self.own}
        return part, source

    def _shared(self) -> Iterator[tuple[list[int], int, Barrier]]:
        """Yield each user's own barrier with its place and the scenes that share the object."""
        groups: dict[tuple[int, int], tuple[list[int], int, Barrier]] = {}
        for (i, k), barrier in self.own.items():
            groups.setdefault((id(barrier), k), ([], k, barrier))[0].append(i)
        yield from groups.values()


def each(scene: Sequence[Entry]) -> Iterator[Barrier | Shapes]:
    """Yield the entries of a scene, those that stand for several one by one.

    Raises:
        InvalidInputError: if an entry is no barrier.
    """
    for entry in _scene(scene):
        if type(entry) in _BUILT_IN:
            yield entry
        else:
            yield from map(_checked, entry.conditions if isinstance(entry, Several) else (entry,))


def _count(cls: type, run: Sequence[Any]) -> int:
    """Return how many barriers entries of one class are.

    Raises:
        InvalidInputError: if an entry is none.
    """
    if cls in _BUILT_IN:
        return len(run)
    return sum(len(b) if isinstance(b, Shapes) else 1 for b in map(_checked, run))


def _checked(barrier: Any) -> Barrier | Shapes:
    if not isinstance(barrier, Barrier | Shapes):
        raise InvalidInputError(
            f"barrier set: got {shown(barrier)}, expected an object of a class derived from "
            "hcbf_gym.barriers.Barrier, Shapes, or a map"
        )
    return barrier


def is_list(scene: object) -> TypeGuard[Sequence[Any]]:
    """Return whether something may be a sequence of barriers, or of such sequences."""
    return isinstance(scene, Sequence) and not isinstance(scene, str | bytes)


def _scene(scene: Any) -> tuple[Any, ...]:
    """Return the entries of a scene.

    Raises:
        InvalidInputError: if it is no sequence.
    """
    if not is_list(scene):
        raise InvalidInputError(f"barrier set: got {shown(scene)}, expected a sequence of Barriers")
    return tuple(scene)


def _stand(read: _Read) -> bool:
    """Return whether entries stand for the very barriers for which they stood."""
    for one, before in read:
        now = one.conditions
        same = now is before or (len(now) == len(before) and all(map(operator.is_, now, before)))
        if not same:
            return False
    return True


def _length(scene: Sequence[Entry]) -> int:
    """Return how many barriers there are.

    Raises:
        InvalidInputError: if an entry is none.
    """
    return sum(_count(cls, list(run)) for cls, run in groupby(each(scene), type))


def _seen(jet: Jet) -> Array:
    """Return (N, 4) h, the unit gradient in the position, ∂h/∂t."""
    gradient = jet.gradient[:, :2]
    norm = np.linalg.norm(gradient, axis=1)[:, None]
    unit = np.divide(gradient, norm, out=np.zeros_like(gradient), where=norm > 0.0)
    return np.column_stack([jet.h, unit, np.where(norm[:, 0] > 0.0, jet.rate, 0.0)])
