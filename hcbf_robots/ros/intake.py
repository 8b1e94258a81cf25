"""Turns messages of scans, maps, zones and goals into barriers and guidance, in other threads."""
# pyright: reportMissingImports=false
# messages come with ROS, or with the extra ros-wheels

import threading
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from geometry_msgs.msg import PointStamped, PolygonStamped, PoseStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan

from hcbf_gym.errors import InvalidInputError, in_words
from hcbf_robots.ros import messages, optional, sources
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.running import LATCHED, MASK, RELIABLE, SENSOR
from hcbf_robots.ros.settings import SourceSettings
from hcbf_robots.ros.sources import Entries
from hcbf_robots.ros.watches import Now
from hcbf_robots.ros.worker import Worker

WARNING_INTERVAL = 1.0
"""Shortest time between two warnings of faulty sources [s]."""


class _Mask(NamedTuple):
    """A mask that a `CostmapFilterInfo` names."""

    topic: str
    limits: dict[str, Any]  # name → value of the parameters of a speed mask


class Intake:
    """Subscribes to sources and goals, and passes the prepared results to the node's core.

    One thread makes barriers of messages, and another computes guidance's field.

    Args:
        core: the node's.
        lock: held while the core takes a result.
        now: returns both clocks.
        hear: makes a subscription of a message's type, a topic, a callback and a quality.
        transforms: those of tf; None without tf.
        logger: the node's, for warnings.
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
        self._masks: dict[str, _Mask] = {}  # of each source that hears a `CostmapFilterInfo`
        self._goal: Any = None  # (2,) of the last message [m]; None if no path leads there
        self._planned_goal: Any = None  # whose field was computed last, or is being computed
        for source in core.settings.sources:
            self._subscribe(source)
        if core.settings.guidance:
            hear(PoseStamped, core.settings.goal_topic, self._on_goal, RELIABLE)
        self._worker, self._planner = Worker(self._refuse_source), Worker(self._end_guidance)

    def _subscribe(self, source: SourceSettings) -> None:
        """Hear the messages of a source, or those that name its mask."""
        by_type: dict[str, tuple[Any, Callable[..., Entries], Any]] = {
            "scan": (LaserScan, self._of_scan, SENSOR),
            "map": (OccupancyGrid, self._of_grid, LATCHED),
            "keepout": (OccupancyGrid, self._of_grid, MASK),
            "speed": (OccupancyGrid, self._of_grid, LATCHED),
            "polygon": (PolygonStamped, self._of_polygon, RELIABLE),
            "circle": (PointStamped, self._of_circle, RELIABLE),
        }
        message_type, convert, quality = by_type[source.type]
        if source.topic:
            prepare = partial(self._prepare, source.name, convert)
            self._hear(message_type, source.topic, prepare, quality)
        if source.filter_info_topic:
            on_info = partial(self._on_filter_info, source.name)
            info_type = optional.nav2("CostmapFilterInfo")
            self._hear(info_type, source.filter_info_topic, on_info, LATCHED)

    def close(self) -> None:
        """Finish the running jobs, and end both threads."""
        self._worker.close()
        self._planner.close()

    def _of_scan(self, name: str, message: Any) -> Entries:
        """Return the barriers of a scan; tf gives its mount unless it is in the robot's frame."""
        core, header, source = self._core, message.header, self._core.sources[name]
        beams, mount, base = messages.beams_of(message), None, core.settings.base_frame_id
        if self._transforms is not None and header.frame_id != base:
            newest = self._transforms.newest(base, header.frame_id)
            if newest is not None:
                mount, is_upside_down = messages.mount_of(newest.transform)
                if is_upside_down:
                    beams = beams._replace(first=-beams.first, step=-beams.step)
                header.frame_id = source.frame  # accepted, as its pose is known
            elif not any(source.settings.mount):
                raise InvalidInputError(
                    f"tf has no transform from {base!r} to {header.frame_id!r}, and {name}.mount "
                    "is not set"
                )
        stamp = messages.seconds(header.stamp)
        if not stamp:
            raise InvalidInputError("header.stamp: got 0, expected when the scan was measured")
        return core.of_scan(name, beams, mount, stamp)

    def _of_grid(self, name: str, message: Any) -> Entries:
        """Return the barriers of a map or a mask."""
        limits = self._masks[name].limits if name in self._masks else None
        return self._core.of_grid(name, messages.raster_of(message), limits)

    def _of_polygon(self, name: str, message: Any) -> Entries:
        """Return the barrier of a polygon; none for a message without corners."""
        corners = messages.corners_of(message.polygon)
        return sources.of_polygon(self._core.sources[name].settings, corners)

    def _of_circle(self, name: str, message: Any) -> Entries:
        """Return the barrier of a circle around x and y of a point, with z as its radius."""
        point = message.point
        return sources.of_circle(self._core.sources[name].settings, (point.x, point.y), point.z)

    def _on_filter_info(self, name: str, message: Any) -> None:
        """Hear the mask that the information names, in the place of an earlier one."""
        limits = {
            "base": float(message.base),
            "multiplier": float(message.multiplier),
            "percent": message.type == 1,
        }
        named = _Mask(message.filter_mask_topic, limits)
        if named == self._masks.get(name):
            return
        self._masks[name] = named

        def on_mask(mask: Any) -> None:
            if self._masks[name].topic == named.topic:  # none that was named earlier
                self._prepare(name, self._of_grid, mask)

        self._hear(OccupancyGrid, named.topic, on_mask, MASK)

    def _prepare(self, name: str, convert: Callable[..., Entries], message: Any) -> None:
        """Let the other thread make barriers of a message, and pass them to the core."""

        def job() -> None:
            core, header, entries = self._core, message.header, convert(name, message)
            now = self._now()  # after the conversion, which takes time
            stamp = messages.seconds(header.stamp) or now.ros
            with self._lock:
                differs = core.hear_source(name, entries, stamp, now, header.frame_id)
            if differs and not core.sources[name].is_scan and self._goal is not None:
                self.plan(self._goal)  # even while its field is being computed

        self._worker.put(name, job)

    def _refuse_source(self, name: str, error: Exception) -> None:
        """Refuse a source until a valid message comes."""
        message = in_words(error)
        with self._lock:
            self._core.refuse_source(name, message)
        self._logger.warning(f"{name}: {message}", throttle_duration_sec=WARNING_INTERVAL)

    def _on_goal(self, message: Any) -> None:
        goal, frame = messages.pose_of(message.pose)[:2], message.header.frame_id
        expected = self._core.settings.global_frame_id
        if frame != expected:
            self._logger.warning(f"goal: got the frame {frame!r}, expected {expected!r}")
        elif self._goal is None or tuple(goal) != tuple(self._goal):  # planners repeat theirs
            self.plan(goal)

    def plan(self, goal: Any) -> None:
        """Let the other thread compute guidance's field to a goal (2,) [m]."""
        self._goal = goal
        self._planner.put("field", partial(self._plan_now, goal))

    def _plan_now(self, goal: Any) -> None:
        """Compute guidance's field to a goal and use it; without a pose the goal waits for one."""
        self._planned_goal = goal
        if self._core.localization.newest is None:
            with self._lock:
                self._core.wait(goal)
            return
        planned = self._core.planned(goal)
        with self._lock:
            if goal is self._goal:  # otherwise another came meanwhile, or the goal was dropped
                self._core.take(planned)

    def drop_goal(self) -> None:
        """Forget the goal, whose field is not used even if it is being computed."""
        self._goal = None

    def _end_guidance(self, name: str, error: Exception) -> None:
        """Continue without guidance, because no path leads to the goal that was planned."""
        if self._goal is self._planned_goal:  # otherwise another goal has come already
            self._goal = None
        message = in_words(error)
        self._logger.warning(f"guidance ends: {message}")
        planned = self._core.planned(None)
        with self._lock:
            self._core.take(planned)
