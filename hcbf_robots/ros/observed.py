"""One source of the node: its barriers, where they are, and whether they are up to date."""

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
    """The barriers of a scan, and the robot's pose by odometry when it was measured."""

    entries: Entries  # in the robot's axes
    pose: Array  # (3,) of the robot in odometry's frame [m, rad]
    stamp: float  # of the measurement [s]


class Source:
    """One source, such as a scan, a map or a zone.

    Args:
        one: its parameters.
        settings: the node's.

    Attributes:
        settings: its parameters.
        watch: over its messages.
        frame: that its messages must have.
        enabled: whether its barriers count.
        entries: its newest barriers, in the global frame.
        measured: the newest scan, in the robot's axes: each correction of the pose places it anew.
    """

    def __init__(self, one: SourceSettings, settings: Settings):
        self.settings, self.enabled = one, one.enabled
        self.is_scan = one.type == "scan"
        timeout = one.source_timeout
        if timeout < 0.0:
            timeout = settings.source_timeout if self.is_scan else 0.0
        self.watch = Watch(one.name, timeout, settings.transform_tolerance)
        usual = settings.base_frame_id if self.is_scan else settings.global_frame_id
        self.frame = one.frame_id or usual
        self.entries: Entries = ()
        self.measured: Measured | None = None

    def begin(self, fastest: float, check: Callable[[Entries], None]) -> None:
        """Show what needs no message: a file, or a zone of the parameters.

        100 % of a speed mask are `fastest` [m/s]; `check` refuses what no input can satisfy.

        Raises:
            InvalidInputError: the message names the parameter.
        """
        one = self.settings
        with naming(f"{one.name}.{PLACES.get(one.type, 'file')}"):
            if one.file:
                raster = nav2.read(one.file, drawn=one.type != "map")
                self.entries = sources.of_grid(one, raster, fastest)
                check(self.entries)
            elif one.type == "polygon":
                self.entries = sources.of_polygon(one, one.points)
            elif one.type == "circle" and one.center:
                self.entries = sources.of_circle(one, one.center, one.radius)
        if one.file or one.type in PLACES:
            self.watch.set_known()

    def hear(self, entries: Entries, stamp: float, now: Now, frame: str) -> bool:
        """Take what a map or a zone shows from now on; return whether it differs from before."""
        stamp = min(stamp, now.ros)  # the last message counts: stamps may be fixed, or another's
        if stamp <= self.watch.stamp:
            self.watch.forget()
        if not self.watch.hear(stamp, now, frame, self.frame):
            return False
        before, self.entries = self.entries, entries
        return not _are_same(before, entries)

    def hear_scan(
        self, entries: Entries, pose: Array | None, stamp: float, now: Now, frame: str
    ) -> bool:
        """Take a scan, with the robot's pose (3,) by odometry; return whether it is accepted."""
        if pose is None or not self.watch.hear(stamp, now, frame, self.frame):
            return False
        self.measured = Measured(entries, pose, min(stamp, now.ros))
        return True

    def place(self, frame: Array) -> None:
        """Place the scan in the global frame, in which odometry's has the pose (3,) [m, rad]."""
        assert self.measured is not None
        robot, scans = placed(frame, self.measured.pose), []
        for scan in self.measured.entries:
            assert isinstance(scan, Scan)
            x, y, yaw = placed(robot, np.array(scan.pose)).tolist()
            scans.append(replace(scan, pose=(x, y, yaw), stamp=self.measured.stamp))
        self.entries = tuple(scans)

    def forget_stamps(self) -> None:
        """Require another scan; maps and zones remain: the clock has gone back."""
        if self.is_scan:
            self.watch.forget()
        else:
            self.watch.forget_stamp()

    def stops(self, place: Array, reach: float) -> bool:
        """Return whether it stops a robot of a radius [m] whose centre is at (2,) [m]."""
        if not self.enabled or self.settings.when_inside != "stop":
            return False
        x = np.array([*place, 0.0, 0.0])
        return any(one.jet(x).h < reach for one in each(self.entries) if isinstance(one, Barrier))


def _are_same(before: Entries, now: Entries) -> bool:
    return len(before) == len(now) and all(
        a is b or (isinstance(a, Shape) and a == b) for a, b in zip(before, now, strict=True)
    )
