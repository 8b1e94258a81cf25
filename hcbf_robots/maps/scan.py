"""The scan of a range sensor as a strict condition: for people and boxes that are in no map."""

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

FINE = 0.005  # distance of points from a piece that is allowed besides the noise [m]
REACH = 6.0  # from the sensor; by default points beyond are left out [m]


@dataclass(frozen=True, eq=False)
class Scan(Several):
    r"""Straight pieces along the surfaces that a sensor has met. Without a point all is free.

    In a list of barriers a scan is one strict condition. As long as it is the newest scan, the
    distance

    .. math:: m + 2 n + b + v \max(T, a)

    is reserved around its pieces. m is the margin. Points miss the surface by the noise n, and
    pieces miss their points by up to n + b, with b = `FINE`. The last term is the motion of people
    and things: their speed v times the scan's age a at the end of the input's period, and at least
    v T. A scan of another clock, or one older than a minute, is accepted only if nothing moves.

    Args:
        name: of the scan in infos and messages.
        points: (k, 2) in the sensor's axes [m], in the order in which its beam turns, as
            `points_of` returns them; infinite ones were not measured.
        pose: x [m], y [m] and yaw [rad] of the sensor in the world, when it measured.
        period: T, the regular time until the next scan replaces this one [s]; an older scan
            reserves more.
        speed: v, of the fastest person or thing around [m/s]; 0 if nothing moves.
        rank: 1 is strict.
        margin: m [m].
        noise: n, the greatest error of a range [m]; of normal errors, three deviations.
        depth: of the pieces, behind the surface [m]. Seen from the sensor it changes no distance. A
            robot that was pushed into a piece is led out by its nearer side.
        reach: points farther ahead or aside are left out [m]; a robot must see as far as
            `VelocityFilter.horizon`.
        stamp: time of the measurement, on the clock of the plant or of `VelocityFilter.step` [s];
            None counts from the first step that has the scan.

    Raises:
        InvalidInputError: if a number is not finite or out of range, or the points are not (k, 2).

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
            self.name, self.rank, pieces=pieces, margin=self.reserved,
            stamp=self.stamp, period=self.period, speed=self.speed,
        )  # fmt: skip
        object.__setattr__(self, "_seen", seen)

    @property
    def reserved(self) -> float:
        """The distance that is reserved around the pieces up to the age T, see `reserved` [m]."""
        return reserved(self.noise, self.period, self.speed, self.margin)

    @property
    def conditions(self) -> tuple[Barrier, ...]:
        """The one barrier of the scan."""
        return (self._seen,)

    def _pieces(self, consumable: float) -> Pieces:
        """Return the pieces in the world, of whose margin errors may consume a part [m]."""
        points = np.asarray(self.points)
        if points.shape[1] != 2:
            raise InvalidInputError(
                f"{self.name}: points: got shape {points.shape}, expected (k, 2)"
            )
        near = points[(np.abs(points) < self.reach).all(axis=1)]
        x, y, yaw = self.pose
        cos, sin = np.cos(yaw), np.sin(yaw)
        to_world = np.array([[cos, sin], [-sin, cos]])
        corners = surfaces.pieces(near, tolerance(self.noise), self.depth) @ to_world + (x, y)
        return Pieces(corners, np.full(len(corners), 4), self.pose, used=consumable)


def tolerance(noise: float) -> float:
    """Return n + b, the greatest distance of a piece from its points [m]."""
    return noise + FINE


def reserved(noise: float, period: float, speed: float, margin: float) -> float:
    """Return m + 2 n + b + v T, the distance that a scan reserves around its pieces [m].

    A point misses the surface by the noise n, and a piece misses the point by `tolerance`.
    """
    return margin + tolerance(noise) + (noise + period * speed)


def points_of(
    ranges: ArrayLike, angles: ArrayLike, name: str = "scan", moved: ArrayLike | None = None
) -> Array:
    """Return the points (k, 2) that beams have met, in the sensor's axes [m].

    Args:
        ranges: (n,) [m]. As in ROS, +inf is a beam that met nothing, and −inf one that met
            something too near to be measured, which counts as range 0. NaN is a failed beam.
        angles: (n,) of the beams in the sensor's axes [rad], in their order.
        name: of the scan in messages.
        moved: (n, 3) x, y [m] and yaw [rad] of the sensor at each beam, in its axes at the stamp;
            None for a sensor that measures all at once, or is at rest.

    Raises:
        InvalidInputError: if there are not as many angles as ranges, or one is no number.
    """
    distances = _numbers(f"{text('name', name)}: ranges", ranges, 1)
    directions = finite_array(f"{name}: angles", angles, (distances.size,))
    distances = np.where(np.isneginf(distances), 0.0, distances)
    if (distances < 0.0).any():
        raise InvalidInputError(f"{name}: ranges: got {distances.min()} m, expected none below 0")
    poses = np.zeros((distances.size, 3))
    if moved is not None:
        poses = finite_array(f"{name}: moved", moved, poses.shape)
    directions = directions + poses[:, 2]
    units = np.column_stack([np.cos(directions), np.sin(directions)])
    met = np.isfinite(distances)
    return poses[met, :2] + distances[met, None] * units[met]


def _numbers(name: str, values: ArrayLike, axes: int) -> Array:
    """Return values as an array with so many axes, whose numbers are finite or infinite."""
    array = as_array(name, values)
    if array.size == 0:  # an empty list has no second axis
        array = array.reshape((0, 2)[:axes])
    if not holds_numbers(array.dtype) or array.ndim != axes:
        raise InvalidInputError(
            f"{name}: got {shown(values)}, expected {axes} axes of real numbers"
        )
    if np.isnan(array).any():
        raise InvalidInputError(
            f"{name}: got NaN, expected numbers, +inf where nothing is in sight"
        )
    return array.astype(np.float64)
