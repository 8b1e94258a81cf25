"""Scans, maps, zones and goals from their messages: prepared beside the path of the commands."""
# pyright: reportMissingImports=false
# messages come with ROS, or with the extra ros-wheels

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PointStamped, PolygonStamped, PoseStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan

from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_robots.ros import messages, optional, sources
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.running import LATCHED, MASK, RELIABLE, SENSOR
from hcbf_robots.ros.settings import SourceSettings
from hcbf_robots.ros.sources import Entries
from hcbf_robots.ros.watches import Now
from hcbf_robots.ros.worker import Worker

OFTEN = 1.0
"""A repeated warning is logged so often [s]."""


class Intake:
    """Hears the sources; one thread makes barriers of them, another guidance's field.

    Args:
        core: which takes what they show.
        lock: held while it does.
        now: returns both clocks.
        hear: makes a subscription of a message's type, a topic, a callback and a quality.
        transforms: of tf, or None.
        logger: for what is refused.
    """

    def __init__(
        self,
        core: NodeCore,
        lock: threading.Lock,
        now: Callable[[], Now],
        hear: Callable[..., Any],
        transforms: "optional.Transforms | None",
        logger: Any,
    ):
        self._core, self._lock, self._now, self._hear = core, lock, now, hear
        self._transforms, self._logger = transforms, logger
        self._masks: dict[str, tuple[str, dict[str, Any]]] = {}  # topic and limits of each
        self._goal: Any = None  # (2,) of the last message [m], until no path leads there
        self._planned: Any = None  # whose field was computed last, or is at this moment
        for one in core.settings.sources:
            self._subscribe(one)
        if core.settings.guidance:
            hear(PoseStamped, core.settings.goal_topic, self._on_goal, RELIABLE)
        self._worker, self._planner = Worker(self._failed), Worker(self._no_path)

    def _subscribe(self, source: SourceSettings) -> None:
        kinds: dict[str, tuple[Any, Callable[..., Entries], Any]] = {
            "scan": (LaserScan, self._scan, SENSOR),
            "map": (OccupancyGrid, self._grid, LATCHED),
            "keepout": (OccupancyGrid, self._grid, MASK),
            "speed": (OccupancyGrid, self._grid, LATCHED),
            "polygon": (PolygonStamped, self._polygon, RELIABLE),
            "circle": (PointStamped, self._circle, RELIABLE),
        }
        kind, shown, quality = kinds[source.type]
        if source.topic:
            self._hear(kind, source.topic, partial(self._prepare, source.name, shown), quality)
        if source.filter_info_topic:
            info = partial(self._on_filter_info, source.name)
            self._hear(optional.nav2("CostmapFilterInfo"), source.filter_info_topic, info, LATCHED)

    def close(self) -> None:
        """Finish the present jobs, and no others."""
        self._worker.close()
        self._planner.close()

    def _scan(self, name: str, message: Any) -> Entries:
        """Return what a scan shows; a frame that tf places becomes the expected one."""
        core, header = self._core, message.header
        beams, mount = messages.beams_of(message), None
        if self._transforms is not None and header.frame_id != core.settings.base_frame_id:
            base = core.settings.base_frame_id
            found = self._transforms.newest(base, header.frame_id)
            if found is not None:
                mount, hangs = messages.mount_of(found.transform)
                if hangs:
                    beams = beams._replace(first=-beams.first, step=-beams.step)
                header.frame_id = core.sources[name].frame
            elif not any(core.sources[name].settings.mount):
                raise InvalidInputError(
                    f"tf has no transform from {base!r} to {header.frame_id!r}, and {name}.mount "
                    "is not set"
                )
        stamp = messages.seconds(header.stamp)
        if not stamp:
            raise InvalidInputError("header.stamp: got 0, expected when the scan was measured")
        return core.of_scan(name, beams, mount, stamp)

    def _grid(self, name: str, message: Any) -> Entries:
        _, limits = self._masks.get(name, ("", None))
        return self._core.of_grid(name, messages.raster_of(message), limits)

    def _polygon(self, name: str, message: Any) -> Entries:
        corners = messages.corners_of(message.polygon)
        return sources.of_polygon(self._core.sources[name].settings, corners)

    def _circle(self, name: str, message: Any) -> Entries:
        """Take x and y of a point as the centre and z as the radius; 0 takes it away."""
        at = message.point
        return sources.of_circle(self._core.sources[name].settings, (at.x, at.y), at.z)

    def _on_filter_info(self, name: str, message: Any) -> None:
        """Hear the mask that the information names, in the place of the one before."""
        limits = {
            "base": float(message.base),
            "multiplier": float(message.multiplier),
            "percent": message.type == 1,
        }
        named = message.filter_mask_topic, limits
        if named == self._masks.get(name):
            return
        self._masks[name] = named

        def heard(mask: Any) -> None:
            if self._masks[name][0] == named[0]:
                self._prepare(name, self._grid, mask)

        self._hear(OccupancyGrid, named[0], heard, MASK)

    def _prepare(self, name: str, shown: Callable[..., Entries], message: Any) -> None:
        """Let the other thread make what a message shows, and pass it on."""

        def job() -> None:
            core, made, now = self._core, shown(name, message), self._now()
            header = message.header
            stamp = messages.seconds(header.stamp) or now.ros
            with self._lock:
                differs = core.hear_source(name, made, stamp, now, header.frame_id)
            if differs and not core.sources[name].is_scan and self._goal is not None:
                self.plan(self._goal)  # also one whose field is computed at this moment

        self._worker.put(name, job)

    def _failed(self, name: str, error: Exception) -> None:
        """Refuse a source until a valid message comes."""
        message = str(error) if isinstance(error, HcbfError | ValueError) else repr(error)
        with self._lock:
            self._core.refuse_source(name, message)
        self._logger.warning(f"{name}: {message}", throttle_duration_sec=OFTEN)

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
        self._planner.put("field", partial(self._lead, goal))

    def _lead(self, goal: Any) -> None:
        """Let guidance lead to a goal through what is known, or let it wait for the first pose."""
        self._planned = goal
        if self._core.localization.newest is None:
            with self._lock:
                self._core.wait(goal)
            return
        planned = self._core.planned(goal)
        with self._lock:
            if goal is self._goal:  # else there is another, or none any more
                self._core.take(planned)

    def drop_goal(self) -> None:
        """Let nothing lead any more."""
        self._goal = None

    def _no_path(self, name: str, error: Exception) -> None:
        """Continue without guidance: no path leads to the goal; another may have come already."""
        if self._goal is self._planned:
            self._goal = None
        message = str(error) if isinstance(error, InvalidInputError) else repr(error)
        self._logger.warning(f"guidance ends: {message}")
        planned = self._core.planned(None)
        with self._lock:
            self._core.take(planned)
