"""What messages of a source become: ranked barriers, made beside the path of the commands.

Nothing here knows ROS: the node hands over numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc
from hcbf_gym.barriers.many import Several, each
from hcbf_gym.barriers.shape import Shape
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float
from hcbf_gym.models.constants import FARTHEST
from hcbf_robots.maps import Grid, MapClass, RankedMap, Scan, nav2, points_of, reading
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.maps.scan import REACH, reserved
from hcbf_robots.online.sample import placed
from hcbf_robots.ros.parameter import naming
from hcbf_robots.ros.parameters import ZONES, Settings, SourceSettings
from hcbf_robots.ros.watches import Watch

Entries = tuple[Barrier | Several, ...]
"""What a source puts into the list of barriers; () where nothing is there."""

FAILED = 0.5
"""Share of a scan's beams that may be NaN; from there on the sensor is taken for broken."""
LONGEST_SWEEP = 0.3
"""From the first beam of a scan to the last [s]: so far a pose may be extrapolated."""


class Measured(NamedTuple):
    """What a scan shows, wherever the robot was.

    Attributes:
        entries: in the robot's axes.
        pose: (3,) of the robot in odometry's frame, when it was measured [m, rad].
        stamp: when that was [s].
    """

    entries: Entries
    pose: Array
    stamp: float


@dataclass
class Source:
    """What is known of one source.

    Attributes:
        settings: its parameters.
        watch: over its messages.
        entries: what it has shown, in the global frame.
        measured: likewise of a scan, by odometry: what is corrected after it moves it, too.
    """

    settings: SourceSettings
    watch: Watch
    entries: Entries = ()
    measured: Measured | None = None
    enabled: bool = field(init=False)

    def __post_init__(self) -> None:
        self.enabled = self.settings.enabled


def of_settings(settings: Settings) -> dict[str, Source]:
    """Return name → source, of which nothing is known yet."""
    found = {}
    for one in settings.sources:
        timeout = one.source_timeout
        if timeout < 0.0:
            timeout = settings.source_timeout if one.type == "scan" else 0.0
        found[one.name] = Source(one, Watch(one.name, timeout, settings.transform_tolerance))
    return found


def begin(source: Source, fastest: float, check: Callable[[Entries], None]) -> None:
    """Let a source show what no message has to say: a file, or a zone of the parameters.

    Args:
        source: the source.
        fastest: what 100 % of a speed mask are [m/s].
        check: refuses what no input can satisfy.

    Raises:
        InvalidInputError: the message names the parameter.
    """
    one = source.settings
    if one.file:
        with naming(f"{one.name}.file"):
            source.entries = of_grid(one, of_file(one), fastest)
            check(source.entries)
    elif one.type == "polygon":
        with naming(f"{one.name}.points"):
            source.entries = of_polygon(one, one.points)
    elif one.type == "circle" and one.center:
        with naming(f"{one.name}.center"):
            source.entries = of_circle(one, one.center, one.radius)
    if one.file or one.type in ZONES:
        source.watch.stand()


class Beams(NamedTuple):
    """One scan, as the sensor has it.

    Attributes:
        ranges: (k,) [m]; NaN failed, +inf saw nothing, −inf is nearer than can be measured.
        first: angle of the first beam [rad].
        step: between two beams [rad].
        least: ranges below it measure nothing [m].
        most: likewise above it [m].
        between: time between two beams [s].
    """

    ranges: ArrayLike
    first: float
    step: float
    least: float
    most: float
    between: float = 0.0

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
    """Return what a scan shows in the robot's axes at its stamp.

    A beam that failed, or is out of range, saw nothing.

    Args:
        source: the scan's settings.
        beams: the scan.
        mount: of the sensor on the robot [m, rad].
        horizon: how far away from the sensor a robot must see a region [m].
        path: (n, 3) poses of the robot, the first at the stamp, the last at the last beam, at equal
            times between [m, rad]; None where it is at rest.

    Raises:
        InvalidInputError: if its limits or its angles are none, there is no beam, half of them
            failed, are negative or nearer than can be measured, or a number is not finite.
    """
    if not 0.0 <= beams.least < beams.most:
        raise InvalidInputError(
            f"range_min and range_max: got {beams.least} and {beams.most}, expected "
            "0 ≤ range_min < range_max"
        )
    far = as_array(source.name, beams.ranges).astype(np.float64)
    if beams.step == 0.0 and far.size > 1:
        raise InvalidInputError(
            f"angle_increment: got 0 with {far.size} ranges, expected the angle between two beams"
        )
    angles = beams.first + beams.step * np.arange(far.size)
    measures_nothing = np.isnan(far) | (np.isfinite(far) & (far < beams.least) & (far != 0.0))
    failed = float(measures_nothing.mean()) if far.size else 1.0
    if (measures_nothing | (far == 0.0)).all():  # a driver's zero is a beam that saw nothing
        raise InvalidInputError(f"none of {far.size} beams says anything, expected ranges or +inf")
    if failed >= FAILED:
        raise InvalidInputError(
            f"{100.0 * failed:.0f} % of {far.size} beams failed or saw something nearer than "
            f"{beams.least:g} m, expected less than half"
        )
    with np.errstate(invalid="ignore"):
        outside = ~(far <= beams.most) | ((far < beams.least) & np.isfinite(far))
    far = np.where(outside, np.inf, far)
    errors = source.range_noise, source.scan_period, source.obstacle_speed
    seen = Scan(
        source.name,
        points_of(far, angles, source.name, _moved(path, mount, far.size)),
        mount,
        source.scan_period,
        source.obstacle_speed,
        source.priority,
        source.margin,
        source.range_noise,
        reach=max(REACH, horizon + reserved(*errors, source.margin)),
    )
    return (seen,)


def _moved(path: Array | None, mount: tuple[float, float, float], count: int) -> Array | None:
    """Return (count, 3) the sensor's pose at each beam, in its axes at the first [m, rad]."""
    if path is None:
        return None
    sensor = np.array([placed(pose, np.array(mount)) for pose in path])
    sensor[:, 2] = np.unwrap(sensor[:, 2])
    when = np.linspace(0.0, len(path) - 1.0, count)
    x, y, yaw = (np.interp(when, np.arange(len(path)), axis) for axis in (sensor - sensor[0]).T)
    cos, sin = np.cos(sensor[0, 2]), np.sin(sensor[0, 2])
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, yaw])


def place(source: Source, frame: Array) -> None:
    """Let a scan lie where odometry's frame (3,) is in the global one [m, rad]."""
    assert source.measured is not None
    robot, made = placed(frame, source.measured.pose), []
    for one in source.measured.entries:
        assert isinstance(one, Scan)
        x, y, yaw = placed(robot, np.array(one.pose)).tolist()
        made.append(replace(one, pose=(x, y, yaw), stamp=source.measured.stamp))
    source.entries = tuple(made)


def grid_of(resolution: float, origin: ArrayLike, rows: int, columns: int) -> Grid:
    """Return where the cells of an occupancy grid lie; ROS has its resolution in float32."""
    x, y, yaw = finite_array("origin", origin, (3,), largest=FARTHEST).tolist()
    return Grid(round(float(resolution), 7), (x, y, yaw), (rows, columns))


def of_file(source: SourceSettings) -> Raster:
    """Read a grid from the map server's file.

    Raises:
        InvalidInputError: if it cannot be read.
    """
    return nav2.read(source.file, drawn=source.type != "map")


def of_grid(
    source: SourceSettings, raster: Raster, fastest: float, before: Entries = ()
) -> Entries:
    """Return what an occupancy grid says; the same object where nothing has changed.

    Args:
        source: the grid's settings.
        raster: the grid.
        fastest: what 100 % of a speed mask are [m/s].
        before: what the source said before: only what has changed is covered anew.

    Raises:
        InvalidInputError: if its values make no classes.
    """
    if source.type == "map":
        unknown = source.unknown or None
        found = reading.of_map(raster, source.priority, unknown, source.margin)
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
    if isinstance(old, RankedMap) and _alike(old, raster.grid, found):
        return (_updated(old, found),)
    if source.type == "map":
        reading.log(source.name, raster)
    made = RankedMap(raster.grid, tuple(found))
    _ = made.conditions  # covered here, and not in the step that takes it
    return (made,)


def _alike(old: RankedMap, grid: Grid, found: Sequence[MapClass]) -> bool:
    """Return whether a map differs from its classes today by cells alone."""
    if old.grid != grid or len(old.classes) != len(found):
        return False
    return all(
        (a.name, a.rank, a.kind, a.limit, a.margin) == (b.name, b.rank, b.kind, b.limit, b.margin)
        for a, b in zip(old.classes, found, strict=True)
    )


def _updated(old: RankedMap, found: Sequence[MapClass]) -> RankedMap:
    """Return a map with the cells that classes have today."""
    changed = old
    for before, now in zip(old.classes, found, strict=True):
        rows, columns = np.nonzero(before.cells != now.cells)
        if rows.size:
            top, left = int(rows.min()), int(columns.min())
            window = now.cells[top : rows.max() + 1, left : columns.max() + 1]
            changed = changed.update((top, left), {now.name: window})
    return changed


def of_polygon(source: SourceSettings, corners: ArrayLike) -> Entries:
    """Return a convex polygon, edges moved outwards by the margin; none for no corner.

    Args:
        source: its settings.
        corners: (k, 2) [m], in either turn.

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
    before = np.roll(normals, 1, axis=0)  # of the edge that ends in the corner
    moved = source.margin * (normals + before)
    moved /= 1.0 + (normals * before).sum(axis=1, keepdims=True)
    return (_polygon(source, given + moved),)


def _polygon(source: SourceSettings, corners: Array) -> ConvexPolygon:
    """Return a convex polygon of a source.

    Raises:
        InvalidInputError: if it is none.
    """
    return ConvexPolygon(source.name, source.priority, tuple((x, y) for x, y in corners.tolist()))


def of_circle(source: SourceSettings, center: ArrayLike, radius: float) -> Entries:
    """Return a disc with the margin around it; none for a radius of 0.

    Args:
        source: its settings.
        center: (2,) [m].
        radius: [m].

    Raises:
        InvalidInputError: if a number is negative or not finite.
    """
    if finite_float("radius", radius, minimum=0.0) == 0.0:
        return ()
    x, y = finite_array("center", center, (2,), largest=FARTHEST).tolist()
    return (Disc(source.name, source.priority, (x, y), radius + source.margin),)


def are_same(before: Entries, now: Entries) -> bool:
    """Return whether a source shows what it has shown before."""
    return len(before) == len(now) and all(
        a is b or (isinstance(a, Shape) and a == b) for a, b in zip(before, now, strict=True)
    )


def inside(entries: Entries, x: Array, reach: float) -> bool:
    """Return whether a robot touches what a source has shown.

    Args:
        entries: of the source.
        x: (4,) position first [m].
        reach: radius of the circle that holds the robot [m].
    """
    touched = (one.jet(x).h < reach for one in each(entries) if isinstance(one, Barrier))
    return any(touched)
