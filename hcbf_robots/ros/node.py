"""The lifecycle node: messages in, the decisions of `core` out. It needs rclpy.

Commands, odometry and the periods of the filter are handled by the executor's thread. What sources
show is prepared in others and passed under a lock that is held for microseconds.
"""
# pyright: reportMissingImports=false
# rclpy comes with ROS, or with the extra ros-wheels

import contextlib
import gc
import logging
import math
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import rclpy.exceptions
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from std_srvs.srv import SetBool

from hcbf_gym.errors import HcbfError, InvalidInputError, SafetyWarning
from hcbf_robots.ros import messages, optional, running
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.decisions import Decision
from hcbf_robots.ros.intake import Intake
from hcbf_robots.ros.parameter import Parameter
from hcbf_robots.ros.parameters import by_name, read
from hcbf_robots.ros.reporting import Reporter
from hcbf_robots.ros.running import RELIABLE, SENSOR
from hcbf_robots.ros.settings import Settings
from hcbf_robots.ros.watches import Now

NAME = "hcbf_filter"

SWITCH = 2e-4
"""After which Python lets the other thread go on [s]."""

DONE, REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class _ToRos(logging.Handler):
    """Passes log records to a node's logger."""

    def __init__(self, logger: Any):
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.info(record.getMessage())


class FilterNode(LifecycleNode):
    """The node; see docs/ros.md for its topics, services and parameters.

    Args:
        **options: as `rclpy.node.Node` takes them.
    """

    def __init__(self, **options: Any):
        super().__init__(NAME, automatically_declare_parameters_from_overrides=True, **options)
        self._core: NodeCore | None = None
        self._intake: Intake | None = None
        self._bond: Any = None
        self._lock = threading.Lock()
        self.is_active = False
        self._log = _ToRos(self.get_logger())
        self._undo: list[tuple[Callable[[Any], Any], Any]] = []
        self._declare()
        self.add_on_set_parameters_callback(self._on_parameters)

    def _given(self) -> dict[str, Any]:
        """Return name → value of what is set; an empty list of a file has no value."""
        found = self.get_parameters_by_prefix("")
        return {name: one.value for name, one in found.items() if one.value is not None}

    def _declare(self) -> None:
        """Declare what no file has given, so that ROS's tools show it with its meaning."""
        listed = self._given().get("observation_sources", ())
        names = [name for name in listed if isinstance(name, str)] if listed else []
        for name, one in by_name(names).items():
            if not self.has_parameter(name):
                default = list(one.default) if isinstance(one.default, tuple) else one.default
                value = None if default == [] else default
                self.declare_parameter(name, value, _descriptor(one))
            else:
                # `configure` refuses a value that does not fit by its name
                with contextlib.suppress(rclpy.exceptions.ParameterException):
                    self.set_descriptor(name, _descriptor(one))

    def _on_parameters(self, changed: list[Any]) -> SetParametersResult:
        """Take what may change while the node runs, and refuse what does not fit."""
        if self._core is None:
            return SetParametersResult(successful=True)  # `configure` reads them all
        try:
            with self._lock, self._logged():
                self._core.change({one.name: one.value for one in changed})
        except InvalidInputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    @contextlib.contextmanager
    def _logged(self) -> Iterator[None]:
        """Log the warnings inside, which Python ignores while the node runs."""
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            yield
        for text in dict.fromkeys(str(one.message) for one in raised):
            self.get_logger().warning(text)

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Read the parameters; a value or a file that does not fit is FAILURE."""
        maps = logging.getLogger("hcbf_robots.maps")
        self._undo.append((maps.removeHandler, self._log))
        maps.setLevel(logging.INFO)
        maps.addHandler(self._log)
        try:
            settings = read(self._given())
            _check_imports(settings)
            self._check_velocities(settings)  # after namespaces and remapping
            with self._logged():
                self._core = NodeCore(settings)
            self._connect(self._core, settings)
        except Exception as error:  # what ROS refuses, such as a topic's name, has many kinds
            message = str(error) if isinstance(error, HcbfError) else repr(error)
            self.get_logger().error(f"configure: {message}")
            self._clean()
            return REFUSED
        gc.collect()
        gc.freeze()  # what was imported stays: no collection shall look at it all again
        return super().on_configure(state)

    def _connect(self, core: NodeCore, settings: Settings) -> None:
        """Make publishers, subscriptions, timers and the other threads."""
        self._stamped = settings.enable_stamped_cmd_vel
        kind = TwistStamped if self._stamped else Twist
        self._velocity = self._publisher(kind, settings.cmd_vel_out_topic)
        self._reporter = Reporter(core, self.get_name(), self._publisher)
        self._transforms = optional.Transforms(self) if optional.Transforms.can_be() else None
        if self._transforms is not None:
            self._undo.append((optional.Transforms.close, self._transforms))
        self._hear(kind, settings.cmd_vel_in_topic, self._on_command, RELIABLE)
        self._hear(Odometry, settings.odom_topic, self._on_odometry, SENSOR)
        if settings.pose_source == "topic":
            self._hear(PoseWithCovarianceStamped, settings.pose_topic, self._on_pose, RELIABLE)
        logger = self.get_logger()
        self._intake = Intake(core, self._lock, self._now, self._hear, self._transforms, logger)
        service = self.create_service(
            optional.nav2("Toggle", "srv") or SetBool, "~/toggle", self._on_toggle
        )
        self._undo.append((self.destroy_service, service))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(settings.period, self._on_period, clock=steady)
        slow = self.create_timer(1.0, self._on_second, clock=steady)
        self._undo += [(self.destroy_timer, self._timer), (self.destroy_timer, slow)]

    def _check_velocities(self, settings: Settings) -> None:
        """Refuse to hear the velocities that the node publishes."""
        wanted, given = settings.cmd_vel_in_topic, settings.cmd_vel_out_topic
        whole = self.resolve_topic_name(given)
        if self.resolve_topic_name(wanted) == whole:
            raise InvalidInputError(
                f"parameter cmd_vel_out_topic: got {given!r}, which is {whole} as {wanted!r} of "
                "cmd_vel_in_topic, expected another"
            )

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin to publish."""
        done = super().on_activate(state)
        with self._lock:
            self._configured.activate()
            if self._intake is not None:
                self._intake.drop_goal()
        self.is_active = True
        if self._configured.settings.use_bond == "auto":
            self._bond = optional.bond(self, self.get_name())
        return done

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Publish zero once more, and nothing after it."""
        if self.is_active:
            self._publish(np.zeros(3))
        self.is_active = False
        if self._bond is not None:
            self._bond.break_bond()
            self._bond = None
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Forget what was configured."""
        self._clean()
        return super().on_cleanup(state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Publish zero if the node was active, and end."""
        self.on_deactivate(state)
        self._clean()
        return super().on_shutdown(state)

    def _clean(self) -> None:
        if self._intake is not None:
            self._intake.close()
        self._intake = self._core = None
        for destroy, one in self._undo:
            destroy(one)
        self._undo = []

    def destroy_node(self) -> None:
        """Destroy the node, and end its threads."""
        self._clean()
        super().destroy_node()

    @property
    def _configured(self) -> NodeCore:
        assert self._core is not None
        return self._core

    def _publisher(self, kind: Any, topic: str) -> Any:
        made = self.create_lifecycle_publisher(kind, topic, RELIABLE)
        self._undo.append((self.destroy_lifecycle_publisher, made))
        return made

    def _hear(self, kind: Any, topic: str, callback: Callable[[Any], None], quality: Any) -> None:
        made = self.create_subscription(kind, topic, callback, quality)
        self._undo.append((self.destroy_subscription, made))

    def _now(self) -> Now:
        return Now(1e-9 * self.get_clock().now().nanoseconds, time.monotonic())

    def _stamp(self) -> Any:
        return self.get_clock().now().to_msg()

    def _on_command(self, message: Any) -> None:
        if not self.is_active:
            return
        begun, now = time.perf_counter(), self._now()
        header = message.header if self._stamped else None
        twist = messages.twist_of(message.twist if self._stamped else message)
        stamp = None if header is None else messages.seconds(header.stamp)
        frame = "" if header is None else header.frame_id
        with self._lock:
            accepted = self._configured.hear_command(twist, now, stamp or None, frame)
        decision = self._decide(now, header if accepted else None)
        self._reporter.note(time.perf_counter() - begun)
        self._timer.reset()
        self._reporter.publish(decision, now, self._stamp())

    def _on_period(self) -> None:
        """Filter the last velocity again: none has come for a period."""
        if not self.is_active:
            return
        now = self._now()
        self._reporter.publish(self._decide(now), now, self._stamp())

    def _decide(self, now: Now, header: Any = None) -> Decision:
        """Publish a decision, and let a goal be planned again whose field was dropped."""
        with self._lock:
            decision, goal = self._configured.step(now), self._configured.goal_to_plan()
        if decision.command is not None:
            self._publish(decision.command, header)
        if goal is not None and self._intake is not None:
            self._intake.plan(goal)
        return decision

    def _publish(self, command: Any, header: Any = None) -> None:
        """Publish a velocity, with the header of the nominal one, or one of now."""
        message: Any = TwistStamped() if self._stamped else Twist()
        if header is not None:
            message.header = header
        elif self._stamped:
            message.header.stamp = self._stamp()
            message.header.frame_id = self._configured.settings.base_frame_id
        messages.write_twist(command, message.twist if self._stamped else message)
        self._velocity.publish(message)

    def _on_odometry(self, message: Any) -> None:
        now, core, header = self._now(), self._configured, message.header
        pose, twist = messages.pose_of(message.pose.pose), messages.twist_of(message.twist.twist)
        stamp, frames = messages.seconds(header.stamp), (header.frame_id, message.child_frame_id)
        with self._lock:
            if self._transforms is not None and core.settings.pose_source == "tf":
                between = core.settings.global_frame_id, core.settings.odom_frame_id
                found = self._transforms.newest(*between)
                placed = None if found is None else messages.transform_of(found.transform)
                at = 0.0 if found is None else messages.seconds(found.header.stamp)
                core.localization.hear_correction(placed, at)
            core.hear_odometry(pose, twist, stamp, now, *frames)

    def _on_pose(self, message: Any) -> None:
        header, pose = message.header, messages.pose_of(message.pose.pose)
        stamp, now = messages.seconds(header.stamp), self._now()
        with self._lock:
            self._configured.localization.hear_pose(pose, stamp, now, header.frame_id)

    def _on_toggle(self, request: Any, response: Any) -> Any:
        """Switch between filtering and passing on, by Nav2's Toggle or SetBool."""
        enable = request.enable if hasattr(request, "enable") else request.data
        with self._lock:
            self._configured.enabled = bool(enable)
        response.success, response.message = True, "enabled" if enable else "commands pass"
        return response

    def _on_second(self) -> None:
        if self.is_active:
            self._reporter.diagnose(self._now(), self._stamp())


def _check_imports(settings: Settings) -> None:
    """Refuse parameters that need a package that is not installed."""
    if settings.pose_source == "tf" and not optional.Transforms.can_be():
        raise InvalidInputError(
            "parameter pose_source: got 'tf' without tf2_ros, expected 'odom' or 'topic'"
        )
    described = [one.name for one in settings.sources if one.filter_info_topic]
    if described and optional.nav2("CostmapFilterInfo") is None:
        raise InvalidInputError(
            f"parameter {described[0]}.filter_info_topic: got it without nav2_msgs, expected "
            "topic, with base and multiplier by parameter"
        )


def _descriptor(one: Parameter) -> ParameterDescriptor:
    """Return what ROS's tools show of a parameter."""
    made = ParameterDescriptor(description=one.about, dynamic_typing=True)
    if one.choices:
        made.additional_constraints = f"one of {', '.join(one.choices)}"
    if one.kind is float and math.isfinite(one.low):
        high = min(float(one.high), sys.float_info.max)
        made.floating_point_range = [FloatingPointRange(from_value=float(one.low), to_value=high)]
    return made


def spin(arguments: list[str], *, autostart: bool) -> None:
    """Run the node, with arguments for ROS, until it is interrupted.

    With `autostart` it configures and activates itself; else a lifecycle manager does.

    Raises:
        InvalidInputError: if it configures itself and a parameter does not fit.
    """
    warnings.simplefilter("ignore", SafetyWarning)  # the diagnostics contain them
    sys.setswitchinterval(SWITCH)

    def begin(node: FilterNode) -> None:
        if autostart and node.trigger_configure() != DONE:
            raise InvalidInputError("the node is not configured, see the line above")
        if autostart:
            node.trigger_activate()

    def end(node: FilterNode) -> None:
        if node.is_active:
            node.trigger_deactivate()

    running.run(FilterNode, arguments, begin, end)
