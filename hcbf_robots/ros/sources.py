"""Makes ranked barriers of scans, grids, polygons and circles; the node passes them as numbers."""

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
"""The barriers of a source; () where there is nothing."""

BROKEN_FROM = 0.5
"""Share of failed beams from which on the sensor counts as broken."""
LONGEST_SWEEP = 0.3
"""Longest time from the first beam of a scan to the last [s]: so far a pose is extrapolated."""


class Beams(NamedTuple):
    """One scan, as the sensor reports it."""

    ranges: ArrayLike  # (k,) [m]; NaN failed, +inf saw nothing, −inf is nearer than `least`
    first: float  # angle of the first beam [rad]
    step: float  # angle from one beam to the next [rad]
    least: float  # shortest range that the sensor measures [m]
    most: float  # longest range that the sensor measures [m]
    between: float = 0.0  # time from one beam to the next [s]

    @property
    def sweep(self) -> float:
        """Time from the first beam to the last [s].

        Raises:
            InvalidInputError: if it is negative or longer than `LONGEST_SWEEP`.
        """
        duration = self.between * max(np.size(self.ranges) - 1, 0)
        if not 0.0 <= duration <= LONGEST_SWEEP:
            raise InvalidInputError(
                f"time_increment: got {self.between:g} s between beams, {duration:g} s from the "
                f"first to the last, expected at most {LONGEST_SWEEP:g} s: 0 for beams of one time"
            )
        return duration


def of_scan(
    source: SourceSettings,
    beams: Beams,
    mount: tuple[float, float, float],
    horizon: float,
    path: Array | None = None,
) -> Entries:
    """Return the barriers of a scan in the robot's axes at its stamp.

    Args:
        source: the scan's settings.
        beams: the scan.
        mount: pose of the sensor on the robot [m, rad].
        horizon: how far from the sensor the robot must see regions [m].
        path: (n, 3) poses of the robot at equal times, from the first beam (at the stamp) to the
            last [m, rad]; None where it is at rest.

    Raises:
        InvalidInputError: if limits or angles are invalid, there is no beam, half of them failed,
            are negative or nearer than can be measured, or a number is not finite.
    """
    ranges = _accepted_ranges(source.name, beams)
    angles = beams.first + beams.step * np.arange(ranges.size)
    sensor_path = _sensor_path(path, mount, ranges.size)
    errors = source.range_noise, source.scan_period, source.obstacle_speed
    scan = Scan(
        name=source.name,
        points=points_of(ranges, angles, source.name, sensor_path),
        pose=mount,
        period=source.scan_period,
        speed=source.obstacle_speed,
        rank=source.priority,
        margin=source.margin,
        noise=source.range_noise,
        reach=max(REACH, horizon + reserved(*errors, source.margin)),
    )
    return (scan,)


def _accepted_ranges(name: str, beams: Beams) -> Array:
    """Return (k,) the ranges of a scan [m]; those that failed or are out of range become +inf."""
    if not 0.0 <= beams.least < beams.most:
        raise InvalidInputError(
            f"range_min and range_max: got {beams.least} and {beams.most}, expected "
            "0 ≤ range_min < range_max"
        )
    ranges = as_array(name, beams.ranges).astype(np.float64)
    count = ranges.size
    if beams.step == 0.0 and count > 1:
        raise InvalidInputError(
            f"angle_increment: got 0 with {count} ranges, expected the angle between two beams"
        )
    is_zero = ranges == 0.0  # some drivers report a beam that saw nothing by 0
    is_near = np.isfinite(ranges) & (ranges < beams.least)
    has_failed = np.isnan(ranges) | (is_near & ~is_zero)
    failed_share = float(has_failed.mean()) if count else 1.0
    if (has_failed | is_zero).all():
        raise InvalidInputError(f"none of {count} beams has a return, expected ranges or +inf")
    if failed_share >= BROKEN_FROM:
        raise InvalidInputError(
            f"{100.0 * failed_share:.0f} % of {count} beams failed or saw something nearer than "
            f"{beams.least:g} m, expected less than half"
        )
    return np.where(~(ranges <= beams.most) | is_near, np.inf, ranges)


def _sensor_path(path: Array | None, mount: tuple[float, float, float], count: int) -> Array | None:
    """Return (count, 3) the sensor's pose at each beam, relative to that at the first [m, rad]."""
    if path is None:
        return None
    poses = np.array([placed(pose, np.array(mount)) for pose in path])
    poses[:, 2] = np.unwrap(poses[:, 2])
    steps, beam_steps = np.arange(len(path)), np.linspace(0.0, len(path) - 1.0, count)
    x, y, yaw = (np.interp(beam_steps, steps, axis) for axis in (poses - poses[0]).T)
    cos, sin = np.cos(poses[0, 2]), np.sin(poses[0, 2])
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, yaw])


def grid_of(resolution: float, origin: ArrayLike, rows: int, columns: int) -> Grid:
    """Return the grid of cells of a side [m], from an origin (3,) [m, rad] on."""
    x, y, yaw = finite_array("origin", origin, (3,), largest=FARTHEST).tolist()
    side = round(float(resolution), 7)  # ROS has it in float32: 0.05 comes as 0.0500000007
    return Grid(side, (x, y, yaw), (rows, columns))


def of_grid(
    source: SourceSettings, raster: Raster, fastest: float, before: Entries = ()
) -> Entries:
    """Return the ranked map of an occupancy grid, or () if it has no classes.

    100 % of a speed mask are `fastest` [m/s]. If only cells differ from the entries `before`, these
    cells alone are covered again, which takes less time. Without a difference the map is the same.

    Raises:
        InvalidInputError: if its values make no classes.
    """
    classes = _classes_of(source, raster, fastest)
    if not classes:
        return ()
    earlier = before[0] if before else None
    if (
        isinstance(earlier, RankedMap)
        and earlier.grid == raster.grid
        and [*map(_rules, earlier.classes)] == [*map(_rules, classes)]
    ):
        return (_with_cells(earlier, classes),)
    if source.type == "map":
        reading.log(source.name, raster)
    ranked_map = RankedMap(raster.grid, tuple(classes))
    _ = ranked_map.conditions  # computed here, because the step that takes it must be short
    return (ranked_map,)


def _classes_of(source: SourceSettings, raster: Raster, fastest: float) -> Sequence[MapClass]:
    """Return the classes of a map, a keepout mask or a speed mask."""
    if source.type == "map":
        return reading.of_map(raster, source.priority, source.unknown or None, source.margin)
    fields = {"name": source.name, "rank": source.priority, "margin": source.margin}
    fields["kind"] = source.type
    if source.type == "speed":
        scale = 0.01 * fastest if source.percent else 1.0
        fields |= {"base": scale * source.base, "multiplier": scale * source.multiplier}
    return reading.of_mask(raster, f"source {source.name}", fields)


def _rules(map_class: MapClass) -> tuple[object, ...]:
    """Return all of a class but its cells."""
    return map_class.name, map_class.rank, map_class.kind, map_class.limit, map_class.margin


def _with_cells(ranked_map: RankedMap, classes: Sequence[MapClass]) -> RankedMap:
    """Return a map with the cells of other classes, of which only the changed part is covered."""
    updated = ranked_map
    for old, new in zip(ranked_map.classes, classes, strict=True):
        rows, columns = np.nonzero(old.cells != new.cells)
        if rows.size:
            top, left = int(rows.min()), int(columns.min())
            window = new.cells[top : rows.max() + 1, left : columns.max() + 1]
            updated = updated.update((top, left), {new.name: window})
    return updated


def of_polygon(source: SourceSettings, corners: ArrayLike) -> Entries:
    """Return a convex polygon whose edges are moved outwards by the margin.

    A corner between edges of the unit normals n₁ and n₂ moves by margin (n₁ + n₂) / (1 + n₁·n₂).
    Corners (k, 2) [m] may be in either order. Without corners () is returned.

    Raises:
        InvalidInputError: if it is not strictly convex or has more than 8 corners.
    """
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    if len(points) == 0:
        return ()
    x, y = points.T
    double_area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    counterclockwise = points if double_area > 0.0 else points[::-1]
    polygon = _polygon(source, counterclockwise)  # an error names the corners without the margin
    if source.margin == 0.0:
        return (polygon,)
    edges = np.roll(counterclockwise, -1, axis=0) - counterclockwise
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    previous = np.roll(normals, 1, axis=0)  # normals of the edges that end in the corners
    step = source.margin * (normals + previous)
    step /= 1.0 + (normals * previous).sum(axis=1, keepdims=True)
    return (_polygon(source, counterclockwise + step),)


def _polygon(source: SourceSettings, corners: Array) -> ConvexPolygon:
    return ConvexPolygon(source.name, source.priority, tuple((x, y) for x, y in corners.tolist()))


def of_circle(source: SourceSettings, center: ArrayLike, radius: float) -> Entries:
    """Return a disc around a centre (2,) [m], of a radius [m] and the margin; () for radius 0.

    Raises:
        InvalidInputError: if a number is negative or not finite.
    """
    if finite_float("radius", radius, minimum=0.0) == 0.0:
        return ()
    x, y = finite_array("center", center, (2,), largest=FARTHEST).tolist()
    return (Disc(source.name, source.priority, (x, y), radius + source.margin),)
