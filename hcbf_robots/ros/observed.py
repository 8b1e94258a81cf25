"""A source of the node, such as a scan or a map: its newest barriers and its faults."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier
from hcbf_gym.barriers.many import each
from hcbf_gym.barriers.shape import Shape
from hcbf_robots.maps import Scan, nav2
from hcbf_robots.online.sample import placed
from hcbf_robots.ros import sources
from hcbf_robots.ros.parameter import naming
from hcbf_robots.ros.settings import PLACES, Settings, SourceSettings
from hcbf_robots.ros.sources import Entries
from hcbf_robots.ros.watches import Now, Watch


class Measured(NamedTuple):
    """The barriers of a scan, and the robot's pose when it was measured."""

    entries: Entries  # in the robot's axes at the stamp
    pose: Array  # (3,) of the robot in odometry's frame [m, rad]
    stamp: float  # of the measurement [s]


class Source:
    """A source with its newest barriers.

    Args:
        settings: the source's parameters.
        node_settings: the node's parameters.

    Attributes:
        watch: checks its messages.
        frame: the frame that its messages must have.
        enabled: whether the filter uses its barriers.
        entries: its newest barriers, in the global frame.
        measured: the newest scan, in the robot's axes: each correction of the pose places it again.
    """

    def __init__(self, settings: SourceSettings, node_settings: Settings):
        self.settings, self.enabled = settings, settings.enabled
        self.is_scan = settings.type == "scan"
        timeout = settings.source_timeout
        if timeout < 0.0:
            timeout = node_settings.source_timeout if self.is_scan else 0.0
        self.watch = Watch(settings.name, timeout, node_settings.transform_tolerance)
        usual_frame = node_settings.base_frame_id if self.is_scan else node_settings.global_frame_id
        self.frame = settings.frame_id or usual_frame
        self.entries: Entries = ()
        self.measured: Measured | None = None

    def begin(self, fastest: float, check: Callable[[Entries], None]) -> None:
        """Make the barriers that need no message: those of a file, or of a zone's parameters.

        100 % of a speed mask are `fastest` [m/s]; `check` refuses what no input can satisfy.

        Raises:
            InvalidInputError: the message names the parameter.
        """
        settings = self.settings
        with naming(f"{settings.name}.{PLACES.get(settings.type, 'file')}"):
            if settings.file:
                raster = nav2.read(settings.file, drawn=settings.type != "map")
                self.entries = sources.of_grid(settings, raster, fastest)
                check(self.entries)
            elif settings.type == "polygon":
                self.entries = sources.of_polygon(settings, settings.points)
            elif settings.type == "circle" and settings.center:
                self.entries = sources.of_circle(settings, settings.center, settings.radius)
        if settings.file or settings.type in PLACES:
            self.watch.set_known()

    def hear(self, entries: Entries, stamp: float, now: Now, frame: str) -> bool:
        """Replace the barriers of a map or a zone; return whether they differ from before.

        The message that came last counts, because publishers may repeat a fixed stamp.
        """
        stamp = min(stamp, now.ros)
        if stamp <= self.watch.stamp:
            self.watch.forget()
        if not self.watch.hear(stamp, now, frame, self.frame):
            return False
        before, self.entries = self.entries, entries
        return not _are_same(before, entries)

    def hear_scan(
        self, entries: Entries, pose: Array | None, stamp: float, now: Now, frame: str
    ) -> bool:
        """Take a scan with the robot's pose (3,) by odometry; return whether it is accepted."""
        if pose is None or not self.watch.hear(stamp, now, frame, self.frame):
            return False
        self.measured = Measured(entries, pose, min(stamp, now.ros))
        return True

    def place(self, frame: Array) -> None:
        """Place the scan in the global frame, where odometry's frame has a pose (3,) [m, rad]."""
        assert self.measured is not None
        robot_pose, scans = placed(frame, self.measured.pose), []
        for scan in self.measured.entries:
            assert isinstance(scan, Scan)
            x, y, yaw = placed(robot_pose, np.array(scan.pose)).tolist()
            scans.append(replace(scan, pose=(x, y, yaw), stamp=self.measured.stamp))
        self.entries = tuple(scans)

    def forget_stamps(self) -> None:
        """Require another scan after the clock has gone back; maps and zones remain."""
        if self.is_scan:
            self.watch.forget()
        else:
            self.watch.forget_stamp()

    def stops(self, position: Array, reach: float) -> bool:
        """Return whether the source stops a robot of a radius [m] at a position (2,) [m]."""
        if not self.enabled or self.settings.when_inside != "stop":
            return False
        x = np.array([*position, 0.0, 0.0])
        barriers = [entry for entry in each(self.entries) if isinstance(entry, Barrier)]
        return any(barrier.jet(x).h < reach for barrier in barriers)


def _are_same(before: Entries, now: Entries) -> bool:
    """Return whether barriers are the same objects, or equal shapes."""
    if len(before) != len(now):
        return False
    pairs = zip(before, now, strict=True)
    return all(old is new or (isinstance(old, Shape) and old == new) for old, new in pairs)
