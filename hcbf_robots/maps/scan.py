"""What a range sensor sees, as strict pieces: for people and boxes that are in no map."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, check_name
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.mapped import SeenRegion
from hcbf_gym.barriers.pieces import Pieces
from hcbf_gym.errors import (
    InvalidInputError,
    as_array,
    finite_array,
    finite_float,
    holds_numbers,
    shown,
    text,
)
from hcbf_gym.models.constants import ON_EARTH
from hcbf_robots.maps import surfaces
from hcbf_robots.maps.surfaces import EDGE

FINE = 0.005  # by how much a surface may bend before it becomes two pieces [m]

REACH = 6.0  # from the sensor [m]: by default nothing beyond is taken


@dataclass(frozen=True, eq=False)
class Scan(Several):
    r"""The surfaces on which points lie, as straight pieces. Without a point all is free.

    Stands in a list of barriers as one strict condition. Around its pieces

    .. math:: m + 2 n + b + v \max(T, a)

    is reserved as long as the scan is the newest: the margin m; the noise n, by which points miss
    what was met; n + b, by which pieces may miss their points (b is `FINE`); and how far something
    may have come. The latter is the speed v times the scan's age a at the end of the input's
    period, and at least v T. A scan of another clock, or one older than a minute, is not accepted
    unless nothing moves.

    Args:
        name: what infos and messages call it.
        points: (k, 2) in the sensor's axes [m], in the order in which its beam turns, as
            `points_of` makes them of ranges; those that are not finite were not measured.
        pose: x [m], y [m] and yaw [rad] of the sensor in the world, when it measured.
        period: how old the scan is at most before another one takes its place [s]; where it becomes
            older, more is reserved.
        speed: of the fastest thing around [m/s]; 0 where nothing moves.
        rank: 1 is strict.
        margin: reserved in any case [m].
        noise: by how much a range is wrong at most [m]; of normal errors, three deviations.
        depth: how far what is seen reaches behind its surface [m]. From where the sensor stood it
            changes no distance; who has been pushed in is led out by the nearer side.
        reach: how far away from the sensor something is taken, ahead and aside [m]; what a robot
            must see is `VelocityFilter.horizon`.
        stamp: when it was measured, on the clock of the plant or of `VelocityFilter.step` [s];
            None counts from the first step that has it.

    Raises:
        InvalidInputError: if a number is not finite or out of range, or the points are no (k, 2).

    Examples:
        >>> points = points_of([1.0, np.inf], [0.0, 0.1])
        >>> seen = Scan("laser", points, (2.0, 0.0, np.pi / 2))
        >>> seen.conditions[0].h(np.array([2.0, 0.0, 0.0, 0.0])) <= 1.0
        True
    """

    name: str
    points: ArrayLike = field(repr=False)
    pose: tuple[float, float, float]
    period: float = 0.0
    speed: float = 0.0
    rank: int = 1
    margin: float = 0.0
    noise: float = 0.0
    depth: float = 0.05
    reach: float = REACH
    stamp: float | None = None
    _seen: SeenRegion = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_name(self.name, self.rank)
        x, y, yaw = finite_array(f"{self.name}: pose", self.pose, (3,), largest=ON_EARTH).tolist()
        object.__setattr__(self, "pose", (x, y, yaw))
        for name in ("period", "speed", "margin", "noise", "depth", "reach"):
            least = EDGE if name == "depth" else 0.0
            number = finite_float(f"{self.name}: {name}", getattr(self, name), minimum=least)
            object.__setattr__(self, name, number)
        if self.stamp is not None:
            stamp = finite_float(f"{self.name}: stamp", self.stamp)
            object.__setattr__(self, "stamp", stamp)
        points = np.array(_numbers(f"{self.name}: points", self.points, 2))
        points.flags.writeable = False
        object.__setattr__(self, "points", points)
        pieces = self._pieces(self.noise + self.period * self.speed)
        seen = SeenRegion(
            self.name,
            self.rank,
            pieces=pieces,
            margin=self.reserved,
            stamp=self.stamp,
            period=self.period,
            speed=self.speed,
        )
        object.__setattr__(self, "_seen", seen)

    @property
    def reserved(self) -> float:
        """What is reserved around its pieces up to the age T, m + 2 n + b + v T [m]."""
        return reserved(self.noise, self.period, self.speed, self.margin)

    @property
    def conditions(self) -> tuple[Barrier, ...]:
        """Its one barrier."""
        return (self._seen,)

    def _pieces(self, errors: float) -> Pieces:
        """Return the pieces in the world, of whose margin errors [m] are a part."""
        given = np.asarray(self.points)
        if given.shape[1] != 2:
            raise InvalidInputError(
                f"{self.name}: points: got shape {given.shape}, expected (k, 2)"
            )
        near = given[(np.abs(given) < self.reach).all(axis=1)]
        x, y, yaw = self.pose
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, sin], [-sin, cos]])
        corners = surfaces.pieces(near, tolerance(self.noise), self.depth) @ turn + (x, y)
        return Pieces(corners, np.full(len(corners), 4), self.pose, used=errors)


def tolerance(noise: float) -> float:
    """Return n + b, how far a piece may be from the points that it fits [m]."""
    return noise + FINE


def reserved(noise: float, period: float, speed: float, margin: float) -> float:
    """Return m + 2 n + b + v T, what a scan reserves around its pieces [m].

    A point is off by the noise n from what was met, and its piece by the tolerance n + b from the
    point. T is the period and v the speed.
    """
    return margin + tolerance(noise) + (noise + period * speed)


def points_of(
    ranges: ArrayLike, angles: ArrayLike, name: str = "scan", moved: ArrayLike | None = None
) -> Array:
    """Return the points (k, 2) that beams see, in the sensor's axes [m].

    Args:
        ranges: (n,) [m]; as ROS has it, +inf saw nothing, and −inf something nearer than can be
            measured, which is taken for the sensor's own place. NaN is a beam that failed.
        angles: (n,) of the beams in the sensor's axes [rad], in their order.
        name: what messages call them.
        moved: (n, 3) x, y [m] and yaw [rad] of the sensor at each beam, in its axes at the stamp;
            None for a sensor that measures all at once, or is at rest.

    Raises:
        InvalidInputError: if there are not as many angles as ranges, or one is no number.
    """
    far = _numbers(f"{text('name', name)}: ranges", ranges, 1)
    turn = finite_array(f"{name}: angles", angles, (far.size,))
    far = np.where(np.isneginf(far), 0.0, far)
    if (far < 0.0).any():
        raise InvalidInputError(f"{name}: ranges: got {far.min()} m, expected none below 0")
    seen = np.isfinite(far)
    poses = np.zeros((far.size, 3))
    if moved is not None:
        poses = finite_array(f"{name}: moved", moved, poses.shape)
    turn = turn + poses[:, 2]
    points = poses[seen, :2]
    return points + far[seen, None] * np.column_stack([np.cos(turn), np.sin(turn)])[seen]


def _numbers(name: str, values: ArrayLike, axes: int) -> Array:
    """Return an array of numbers, finite or infinite."""
    given = as_array(name, values)
    given = given.reshape((0, 2)[:axes]) if given.size == 0 else given
    if not holds_numbers(given.dtype) or given.ndim != axes:
        raise InvalidInputError(
            f"{name}: got {shown(values)}, expected {axes} axes of real numbers"
        )
    if np.isnan(given).any():
        raise InvalidInputError(
            f"{name}: got NaN, expected numbers, +inf where nothing is in sight"
        )
    return given.astype(np.float64)
