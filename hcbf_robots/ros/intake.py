"""Scans, maps, zones and goals from their messages: prepared beside the path of the commands."""
# pyright: reportMissingImports=false
# messages come with ROS, or with the extra ros-wheels

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from geometry_msgs.msg import PointStamped, PolygonStamped, PoseStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan

from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_robots.ros import messages, optional, sources
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.parameters import SourceSettings
from hcbf_robots.ros.running import LATCHED, MASK, RELIABLE, SENSOR
from hcbf_robots.ros.sources import Entries
from hcbf_robots.ros.watches import Now
from hcbf_robots.ros.worker import Worker

OFTEN = 1.0
"""A warning that comes again and again is logged so often [s]."""


class Shown(NamedTuple):
    """What a message shows.

    Attributes:
        entries: barriers.
        frame: in which they are.
    """

    entries: Entries
    frame: str


class Intake:
    """Hears the sources; one thread makes barriers of them, another guidance's field.

    Args:
        core: which takes what they show.
        lock: held while it does.
        now: tells both clocks.
        hear: makes a subscription of a message's type, a topic, a callback and a quality.
        transforms: of tf, or None.
        logger: for what cannot be believed.
    """

    def __init__(
        self,
        core: NodeCore,
        lock: Any,
        now: Callable[[], Now],
        hear: Callable[..., Any],
        transforms: "optional.Transforms | None",
        logger: Any,
    ):
        self._core, self._lock, self._now, self._hear = core, lock, now, hear
        self._transforms, self._logger = transforms, logger
        self._limits: dict[str, dict[str, Any]] = {}
        self._masks: dict[str, str] = {}
        self._goal: Any = None  # (2,) that was asked for last [m], until no way leads there
        self._planned: Any = None  # whose field was computed last, or is at this moment
        for one in core.settings.sources:
            self._subscribe(one)
        if core.settings.guidance:
            hear(PoseStamped, core.settings.goal_topic, self._on_goal, RELIABLE)
        self._worker, self._planner = Worker(self._failed), Worker(self._no_way)

    def _subscribe(self, source: SourceSettings) -> None:
        kinds: dict[str, Any] = {
            "scan": (LaserScan, self._on_scan, SENSOR),
            "map": (OccupancyGrid, self._on_grid, LATCHED),
            "keepout": (OccupancyGrid, self._on_grid, MASK),
            "speed": (OccupancyGrid, self._on_grid, LATCHED),
            "polygon": (PolygonStamped, self._on_polygon, RELIABLE),
            "circle": (PointStamped, self._on_circle, RELIABLE),
        }
        kind, callback, quality = kinds[source.type]
        if source.topic:
            self._hear(kind, source.topic, functools.partial(callback, source.name), quality)
        if source.filter_info_topic:
            told = functools.partial(self._on_filter_info, source.name)
            self._hear(optional.filter_info(), source.filter_info_topic, told, LATCHED)

    def close(self) -> None:
        """Finish what is being prepared, and nothing more."""
        self._worker.close()
        self._planner.close()

    def _on_scan(self, name: str, message: Any) -> None:
        self._prepare(name, message.header, lambda: self._scan(name, message))

    def _scan(self, name: str, message: Any) -> Shown:
        core, frame = self._core, message.header.frame_id
        beams, mount = messages.beams_of(message), None
        if self._transforms is not None and frame != core.settings.base_frame_id:
            found = self._transforms.newest(core.settings.base_frame_id, frame)
            if found is not None:
                mount, hangs = messages.mount_of(found.transform)
                if hangs:
                    beams = beams._replace(first=-beams.first, step=-beams.step)
                frame = core.frame_of(core.sources[name].settings)  # as good as there
            elif not any(core.sources[name].settings.mount):
                raise InvalidInputError(
                    f"tf has no transform from {core.settings.base_frame_id!r} to {frame!r}, and "
                    f"{name}.mount is not set"
                )
        stamp = messages.seconds(message.header.stamp)
        if not stamp:
            raise InvalidInputError("header.stamp: got 0, expected when the scan was measured")
        return Shown(core.of_scan(name, beams, mount, stamp), frame)

    def _on_grid(self, name: str, message: Any) -> None:
        def shown() -> Shown:
            made = self._core.of_grid(name, messages.raster_of(message), self._limits.get(name))
            return Shown(made, message.header.frame_id)

        self._prepare(name, message.header, shown)

    def _on_filter_info(self, name: str, message: Any) -> None:
        """Hear the mask that the information names, in the place of the one before."""
        limits = {
            "base": float(message.base),
            "multiplier": float(message.multiplier),
            "percent": message.type == 1,
        }
        topic = message.filter_mask_topic
        if (topic, limits) == (self._masks.get(name), self._limits.get(name)):
            return
        self._masks[name], self._limits[name] = topic, limits

        def heard(mask: Any) -> None:
            if self._masks[name] == topic:
                self._on_grid(name, mask)

        self._hear(OccupancyGrid, topic, heard, MASK)

    def _on_polygon(self, name: str, message: Any) -> None:
        settings = self._core.sources[name].settings
        corners = messages.corners_of(message.polygon)
        frame = message.header.frame_id
        self._prepare(
            name, message.header, lambda: Shown(sources.of_polygon(settings, corners), frame)
        )

    def _on_circle(self, name: str, message: Any) -> None:
        """Take x and y of a point as the centre and z as the radius; 0 takes it away."""
        settings, at = self._core.sources[name].settings, message.point
        frame = message.header.frame_id
        self._prepare(
            name,
            message.header,
            lambda: Shown(sources.of_circle(settings, (at.x, at.y), at.z), frame),
        )

    def _prepare(self, name: str, header: Any, shown: Callable[[], Shown]) -> None:
        """Let the other thread make what a message shows, and hand it over."""
        stamp = messages.seconds(header.stamp)

        def job() -> None:
            core, (made, frame) = self._core, shown()
            now = self._now()
            with self._lock:
                differs = core.hear_source(name, made, stamp or now.ros, now, frame)
            is_scan = core.sources[name].settings.type == "scan"
            if differs and not is_scan and self._goal is not None:
                self.plan(self._goal)  # also one whose field is computed at this moment

        self._worker.put(name, job)

    def _failed(self, name: str, error: Exception) -> None:
        """Do not believe a source any more, until there is a message that can be used."""
        says = str(error) if isinstance(error, HcbfError | ValueError) else repr(error)
        with self._lock:
            self._core.refuse_source(name, says)
        self._logger.warning(f"{name}: {says}", throttle_duration_sec=OFTEN)

    def _on_goal(self, message: Any) -> None:
        goal, frame = messages.pose_of(message.pose)[:2], message.header.frame_id
        expected = self._core.settings.global_frame_id
        if frame != expected:
            self._logger.warning(f"goal: got the frame {frame!r}, expected {expected!r}")
        elif self._goal is None or tuple(goal) != tuple(self._goal):  # planners repeat theirs
            self.plan(goal)

    def plan(self, goal: Any) -> None:
        """Let the other thread compute guidance's field to a goal."""
        self._goal = goal
        self._planner.put("field", functools.partial(self._lead, goal))

    def _lead(self, goal: Any) -> None:
        """Let guidance lead to a goal through what is known, which waits for the first pose."""
        self._planned = goal
        if not self._core.is_localized:
            with self._lock:
                self._core.wait(goal)
            return
        planned = self._core.planned(goal)
        with self._lock:
            if goal is self._goal:  # else another is asked for, or none any more
                self._core.take(planned)

    def drop_goal(self) -> None:
        """Let nothing lead any more."""
        self._goal = None

    def _no_way(self, name: str, error: Exception) -> None:
        """Go on without guidance: the goal cannot be reached; another may be asked for already."""
        if self._goal is self._planned:
            self._goal = None
        says = str(error) if isinstance(error, InvalidInputError) else repr(error)
        self._logger.warning(f"guidance ends: {says}")
        planned = self._core.planned(None)
        with self._lock:
            self._core.take(planned)
