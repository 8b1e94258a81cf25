"""Makes ranked barriers of a source's messages, in a thread beside that of the commands.

Nothing here imports ROS: the node passes numbers.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc
from hcbf_gym.barriers.many import Several
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float
from hcbf_gym.models.constants import FARTHEST
from hcbf_robots.maps import Grid, MapClass, RankedMap, Scan, points_of, reading
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.maps.scan import REACH, reserved
from hcbf_robots.online.sample import placed
from hcbf_robots.ros.settings import SourceSettings

Entries = tuple[Barrier | Several, ...]
"""The barriers of a source; () where it shows nothing."""

FAILED = 0.5
"""Share of a scan's beams that fail from which on the sensor counts as broken."""
LONGEST_SWEEP = 0.3
"""From the first beam of a scan to the last [s]: so far a pose may be extrapolated."""


class Beams(NamedTuple):
    """One scan, as the sensor has it."""

    ranges: ArrayLike  # (k,) [m]; NaN failed, +inf saw nothing, −inf is nearer than is measured
    first: float  # angle of the first beam [rad]
    step: float  # between two beams [rad]
    least: float  # the shortest range that is measured [m]
    most: float  # the longest [m]
    between: float = 0.0  # time between two beams [s]

    @property
    def sweep(self) -> float:
        """Time from the first beam to the last [s].

        Raises:
            InvalidInputError: if it is negative or longer than `LONGEST_SWEEP`.
        """
        lasts = self.between * max(np.size(self.ranges) - 1, 0)
        if not 0.0 <= lasts <= LONGEST_SWEEP:
            raise InvalidInputError(
                f"time_increment: got {self.between:g} s between beams, {lasts:g} s from the first "
                f"to the last, expected at most {LONGEST_SWEEP:g} s: 0 for beams of one time"
            )
        return lasts


def of_scan(
    source: SourceSettings,
    beams: Beams,
    mount: tuple[float, float, float],
    horizon: float,
    path: Array | None = None,
) -> Entries:
    """Return the barriers of a scan in the robot's axes at its stamp.

    A beam that failed or is out of range counts as one that saw nothing, +inf.

    Args:
        source: the scan's settings.
        beams: the scan.
        mount: of the sensor on the robot [m, rad].
        horizon: how far away from the sensor a robot must see a region [m].
        path: (n, 3) poses of the robot, the first at the stamp, the last at the last beam, at equal
            times between [m, rad]; None where it is at rest.

    Raises:
        InvalidInputError: if limits or angles are invalid, there is no beam, half of them failed,
            are negative or nearer than can be measured, or a number is not finite.
    """
    if not 0.0 <= beams.least < beams.most:
        raise InvalidInputError(
            f"range_min and range_max: got {beams.least} and {beams.most}, expected "
            "0 ≤ range_min < range_max"
        )
    ranges = as_array(source.name, beams.ranges).astype(np.float64)
    count = ranges.size
    if beams.step == 0.0 and count > 1:
        raise InvalidInputError(
            f"angle_increment: got 0 with {count} ranges, expected the angle between two beams"
        )
    angles = beams.first + beams.step * np.arange(count)
    is_zero = ranges == 0.0  # by which some drivers report a beam that saw nothing
    is_near = np.isfinite(ranges) & (ranges < beams.least)
    has_failed = np.isnan(ranges) | (is_near & ~is_zero)
    failed = float(has_failed.mean()) if count else 1.0
    if (has_failed | is_zero).all():
        raise InvalidInputError(f"none of {count} beams has a return, expected ranges or +inf")
    if failed >= FAILED:
        raise InvalidInputError(
            f"{100.0 * failed:.0f} % of {count} beams failed or saw something nearer than "
            f"{beams.least:g} m, expected less than half"
        )
    ranges = np.where(~(ranges <= beams.most) | is_near, np.inf, ranges)
    errors = source.range_noise, source.scan_period, source.obstacle_speed
    scan = Scan(
        source.name,
        points_of(ranges, angles, source.name, _sensor_path(path, mount, count)),
        mount,
        source.scan_period,
        source.obstacle_speed,
        source.priority,
        source.margin,
        source.range_noise,
        reach=max(REACH, horizon + reserved(*errors, source.margin)),
    )
    return (scan,)


def _sensor_path(path: Array | None, mount: tuple[float, float, float], count: int) -> Array | None:
    """Return (count, 3) the sensor's pose at each beam, in its own axes at the first [m, rad]."""
    if path is None:
        return None
    sensor = np.array([placed(pose, np.array(mount)) for pose in path])
    sensor[:, 2] = np.unwrap(sensor[:, 2])
    at_beam = np.linspace(0.0, len(path) - 1.0, count)
    x, y, yaw = (np.interp(at_beam, np.arange(len(path)), axis) for axis in (sensor - sensor[0]).T)
    cos, sin = np.cos(sensor[0, 2]), np.sin(sensor[0, 2])
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, yaw])


def grid_of(resolution: float, origin: ArrayLike, rows: int, columns: int) -> Grid:
    """Return the grid of an occupancy grid's cells; ROS has its resolution in float32."""
    x, y, yaw = finite_array("origin", origin, (3,), largest=FARTHEST).tolist()
    return Grid(round(float(resolution), 7), (x, y, yaw), (rows, columns))


def of_grid(
    source: SourceSettings, raster: Raster, fastest: float, before: Entries = ()
) -> Entries:
    """Return the map of an occupancy grid; the same object where nothing has changed.

    100 % of a speed mask are `fastest` [m/s]. Where only cells differ from the entries `before`,
    these alone are covered anew, which takes less time.

    Raises:
        InvalidInputError: if its values make no classes.
    """
    if source.type == "map":
        found = reading.of_map(raster, source.priority, source.unknown or None, source.margin)
    else:
        fields = {"name": source.name, "rank": source.priority, "margin": source.margin}
        fields["kind"] = source.type
        if source.type == "speed":
            scale = 0.01 * fastest if source.percent else 1.0
            fields |= {"base": scale * source.base, "multiplier": scale * source.multiplier}
        found = reading.of_mask(raster, f"source {source.name}", fields)
    if not found:
        return ()
    old = before[0] if before else None
    if isinstance(old, RankedMap) and old.grid == raster.grid and _are_alike(old.classes, found):
        return (_updated(old, found),)
    if source.type == "map":
        reading.log(source.name, raster)
    ranked_map = RankedMap(raster.grid, tuple(found))
    _ = ranked_map.conditions  # covered here, and not in the step that takes it
    return (ranked_map,)


def _are_alike(old: Sequence[MapClass], found: Sequence[MapClass]) -> bool:
    """Return whether classes differ by cells alone."""
    rules = [
        [(one.name, one.rank, one.kind, one.limit, one.margin) for one in classes]
        for classes in (old, found)
    ]
    return rules[0] == rules[1]


def _updated(old: RankedMap, found: Sequence[MapClass]) -> RankedMap:
    """Return a map with the cells of new classes."""
    changed = old
    for before, now in zip(old.classes, found, strict=True):
        rows, columns = np.nonzero(before.cells != now.cells)
        if rows.size:
            top, left = int(rows.min()), int(columns.min())
            window = now.cells[top : rows.max() + 1, left : columns.max() + 1]
            changed = changed.update((top, left), {now.name: window})
    return changed


def of_polygon(source: SourceSettings, corners: ArrayLike) -> Entries:
    """Return a convex polygon of corners (k, 2) [m], edges moved outwards by the margin.

    A corner between edges of the unit normals n₁ and n₂ moves by margin (n₁ + n₂) / (1 + n₁·n₂).
    Corners may be in either order; without one there is no polygon.

    Raises:
        InvalidInputError: if it is not strictly convex or has more than 8 corners.
    """
    given = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    if len(given) == 0:
        return ()
    x, y = given.T
    area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    given = given if area > 0.0 else given[::-1]
    zone = _polygon(source, given)  # refused as it was given, not as it grows
    if source.margin == 0.0:
        return (zone,)
    edges = np.roll(given, -1, axis=0) - given
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    previous = np.roll(normals, 1, axis=0)  # of the edge that ends in the corner
    step = source.margin * (normals + previous)
    step /= 1.0 + (normals * previous).sum(axis=1, keepdims=True)
    return (_polygon(source, given + step),)


def _polygon(source: SourceSettings, corners: Array) -> ConvexPolygon:
    return ConvexPolygon(source.name, source.priority, tuple((x, y) for x, y in corners.tolist()))


def of_circle(source: SourceSettings, center: ArrayLike, radius: float) -> Entries:
    """Return a disc around (2,) [m] of a radius [m] and the margin; none for a radius of 0.

    Raises:
        InvalidInputError: if a number is negative or not finite.
    """
    if finite_float("radius", radius, minimum=0.0) == 0.0:
        return ()
    x, y = finite_array("center", center, (2,), largest=FARTHEST).tolist()
    return (Disc(source.name, source.priority, (x, y), radius + source.margin),)
