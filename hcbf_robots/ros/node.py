"""The lifecycle node: it passes messages to `core` and publishes the decisions. It needs rclpy.

The executor's thread handles commands, odometry and the periods of the filter. Other threads turn
the sources' messages into barriers, and pass them under a lock that is held for microseconds.
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

from hcbf_gym.errors import InvalidInputError, SafetyWarning, in_words
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

SWITCH_INTERVAL = 2e-4
"""Time after which Python switches to another thread [s]: the usual 5 ms would delay commands."""

DONE, REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class _RosLogHandler(logging.Handler):
    """Passes records of Python's logging to a node's logger."""

    def __init__(self, logger: Any):
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.info(record.getMessage())


class FilterNode(LifecycleNode):
    """The lifecycle node; its topics, services and parameters are on the page docs/ros.md.

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
        self._log_handler = _RosLogHandler(self.get_logger())
        self._cleanup = contextlib.ExitStack()  # undoes `on_configure`
        self._declare()
        self.add_on_set_parameters_callback(self._on_parameters)

    def _given_values(self) -> dict[str, Any]:
        """Return name → value of the parameters that are set; an empty list in a file has none."""
        parameters = self.get_parameters_by_prefix("")
        return {name: given.value for name, given in parameters.items() if given.value is not None}

    def _declare(self) -> None:
        """Declare and describe all parameters, so that ROS's tools show them with their meaning."""
        listed = self._given_values().get("observation_sources") or ()
        sources = [name for name in listed if isinstance(name, str)]
        for name, parameter in by_name(sources).items():
            default = parameter.default
            if isinstance(default, tuple):
                default = list(default) or None  # ROS cannot infer the type of an empty list
            if not self.has_parameter(name):
                self.declare_parameter(name, default, _descriptor(parameter))
                continue
            # a value out of the range raises here; `on_configure` refuses it by its name
            with contextlib.suppress(rclpy.exceptions.ParameterException):
                self.set_descriptor(name, _descriptor(parameter))

    def _on_parameters(self, changed: list[Any]) -> SetParametersResult:
        """Take parameters that may change while the node runs, and refuse what does not fit."""
        if self._core is None:
            return SetParametersResult(successful=True)  # `on_configure` reads them all
        try:
            with self._lock, self._logged_warnings():
                self._core.change({parameter.name: parameter.value for parameter in changed})
        except InvalidInputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    @contextlib.contextmanager
    def _logged_warnings(self) -> Iterator[None]:
        """Log the warnings of the block, each once; Python ignores them while the node runs."""
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            yield
        for message in dict.fromkeys(str(warning.message) for warning in raised):
            self.get_logger().warning(message)

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Read the parameters and connect; a value or a file that does not fit is FAILURE."""
        maps_logger = logging.getLogger("hcbf_robots.maps")
        self._cleanup.callback(maps_logger.removeHandler, self._log_handler)
        maps_logger.setLevel(logging.INFO)
        maps_logger.addHandler(self._log_handler)
        try:
            settings = read(self._given_values())
            _check_imports(settings)
            self._check_velocity_topics(settings)
            with self._logged_warnings():
                self._core = NodeCore(settings)
            self._connect(self._core, settings)
        except Exception as error:  # ROS refuses a topic's name, for example, by various classes
            message = in_words(error)
            self.get_logger().error(f"configure: {message}")
            self._clean()
            return REFUSED
        gc.collect()
        gc.freeze()  # later collections skip what is imported, which takes them milliseconds
        return super().on_configure(state)

    def _connect(self, core: NodeCore, settings: Settings) -> None:
        """Make publishers, subscriptions, timers and the other threads."""
        self._is_stamped = settings.enable_stamped_cmd_vel
        velocity_type = TwistStamped if self._is_stamped else Twist
        self._velocity = self._publisher(velocity_type, settings.cmd_vel_out_topic)
        self._reporter = Reporter(core, self.get_name(), self._publisher)
        self._transforms = None
        if optional.Transforms.can_be_imported():
            self._transforms = optional.Transforms(self)
            self._cleanup.callback(self._transforms.close)
        self._hear(velocity_type, settings.cmd_vel_in_topic, self._on_command, RELIABLE)
        self._hear(Odometry, settings.odom_topic, self._on_odometry, SENSOR)
        if settings.pose_source == "topic":
            self._hear(PoseWithCovarianceStamped, settings.pose_topic, self._on_pose, RELIABLE)
        logger = self.get_logger()
        self._intake = Intake(core, self._lock, self._now, self._hear, self._transforms, logger)
        toggle_type = optional.nav2("Toggle", "srv") or SetBool
        toggle = self.create_service(toggle_type, "~/toggle", self._on_toggle)
        self._cleanup.callback(self.destroy_service, toggle)
        self._period_timer = self._timer(settings.period, self._on_period)
        self._timer(1.0, self._on_second)

    def _check_velocity_topics(self, settings: Settings) -> None:
        """Refuse to hear the published velocities, by names after namespaces and remapping."""
        nominal, filtered = settings.cmd_vel_in_topic, settings.cmd_vel_out_topic
        whole_name = self.resolve_topic_name(filtered)
        if self.resolve_topic_name(nominal) == whole_name:
            raise InvalidInputError(
                f"parameter cmd_vel_out_topic: got {filtered!r}, which is {whole_name} as "
                f"{nominal!r} of cmd_vel_in_topic, expected another"
            )

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin to publish."""
        result = super().on_activate(state)
        with self._lock:
            self._configured.activate()
            if self._intake is not None:
                self._intake.drop_goal()
        self.is_active = True
        if self._configured.settings.use_bond == "auto":
            self._bond = optional.bond(self, self.get_name())
        return result

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Publish zero velocity once more, and nothing after it."""
        if self.is_active:
            self._publish(np.zeros(3))
        self.is_active = False
        if self._bond is not None:
            self._bond.break_bond()
            self._bond = None
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Undo `on_configure`."""
        self._clean()
        return super().on_cleanup(state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Publish zero velocity if the node was active, and undo `on_configure`."""
        self.on_deactivate(state)
        self._clean()
        return super().on_shutdown(state)

    def _clean(self) -> None:
        """End the other threads, and destroy what `on_configure` has made."""
        if self._intake is not None:
            self._intake.close()
        self._intake = self._core = None
        self._cleanup.close()

    def destroy_node(self) -> None:
        """End the other threads, and destroy the node."""
        self._clean()
        super().destroy_node()

    @property
    def _configured(self) -> NodeCore:
        """The core, in callbacks that run only while the node is configured."""
        assert self._core is not None
        return self._core

    def _publisher(self, message_type: Any, topic: str) -> Any:
        publisher = self.create_lifecycle_publisher(message_type, topic, RELIABLE)
        self._cleanup.callback(self.destroy_lifecycle_publisher, publisher)
        return publisher

    def _hear(self, message_type: Any, topic: str, callback: Callable[..., Any], qos: Any) -> None:
        subscription = self.create_subscription(message_type, topic, callback, qos)
        self._cleanup.callback(self.destroy_subscription, subscription)

    def _timer(self, period: float, callback: Callable[[], None]) -> Any:
        """Return a timer on the steady clock, as a node's clock may stop."""
        timer = self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._cleanup.callback(self.destroy_timer, timer)
        return timer

    def _now(self) -> Now:
        return Now(1e-9 * self.get_clock().now().nanoseconds, time.monotonic())

    def _stamp(self) -> Any:
        """Return the present on the node's clock, as a `builtin_interfaces/Time`."""
        return self.get_clock().now().to_msg()

    def _on_command(self, message: Any) -> None:
        if not self.is_active:
            return
        begun, now = time.perf_counter(), self._now()
        header, stamp, frame, twist = None, None, "", message
        if self._is_stamped:
            header, frame, twist = message.header, message.header.frame_id, message.twist
            stamp = messages.seconds(header.stamp) or None  # 0 means that there is none
        with self._lock:
            is_accepted = self._configured.hear_command(messages.twist_of(twist), now, stamp, frame)
        decision = self._decide(now, header if is_accepted else None)
        self._reporter.note_latency(time.perf_counter() - begun)
        self._period_timer.reset()
        self._reporter.publish(decision, now, self._stamp())

    def _on_period(self) -> None:
        """Filter the last velocity again, because none has come for a period."""
        if not self.is_active:
            return
        now = self._now()
        self._reporter.publish(self._decide(now), now, self._stamp())

    def _decide(self, now: Now, header: Any = None) -> Decision:
        """Publish the core's decision; plan the goal again if its field was dropped."""
        with self._lock:
            decision, goal = self._configured.step(now), self._configured.goal_to_plan()
        if decision.command is not None:
            self._publish(decision.command, header)
        if goal is not None and self._intake is not None:
            self._intake.plan(goal)
        return decision

    def _publish(self, command: Any, header: Any = None) -> None:
        """Publish a velocity, with the header of the nominal one, or with the present stamp."""
        message: Any = TwistStamped() if self._is_stamped else Twist()
        if header is not None:
            message.header = header
        elif self._is_stamped:
            message.header.stamp = self._stamp()
            message.header.frame_id = self._configured.settings.base_frame_id
        messages.write_twist(command, message.twist if self._is_stamped else message)
        self._velocity.publish(message)

    def _on_odometry(self, message: Any) -> None:
        now, header = self._now(), message.header
        pose, twist = messages.pose_of(message.pose.pose), messages.twist_of(message.twist.twist)
        stamp, frames = messages.seconds(header.stamp), (header.frame_id, message.child_frame_id)
        with self._lock:
            if self._configured.settings.pose_source == "tf":
                self._look_up_correction()
            self._configured.hear_odometry(pose, twist, stamp, now, *frames)

    def _look_up_correction(self) -> None:
        """Pass the newest pose of odometry's frame in the global one, as tf has it, to the core."""
        assert self._transforms is not None  # `_check_imports`
        settings, correction, stamp = self._configured.settings, None, 0.0
        newest = self._transforms.newest(settings.global_frame_id, settings.odom_frame_id)
        if newest is not None:
            correction = messages.transform_of(newest.transform)
            stamp = messages.seconds(newest.header.stamp)
        self._configured.localization.hear_correction(correction, stamp)

    def _on_pose(self, message: Any) -> None:
        header, pose = message.header, messages.pose_of(message.pose.pose)
        stamp, now = messages.seconds(header.stamp), self._now()
        with self._lock:
            self._configured.localization.hear_pose(pose, stamp, now, header.frame_id)

    def _on_toggle(self, request: Any, response: Any) -> Any:
        """Switch the filter on or off, by a request of Nav2's Toggle or of SetBool."""
        enable = request.enable if hasattr(request, "enable") else request.data
        with self._lock:
            self._configured.enabled = bool(enable)
        response.success, response.message = True, "enabled" if enable else "commands pass"
        return response

    def _on_second(self) -> None:
        if self.is_active:
            self._reporter.diagnose(self._now(), self._stamp())


def _check_imports(settings: Settings) -> None:
    """Refuse parameters for which a package is not installed."""
    if settings.pose_source == "tf" and not optional.Transforms.can_be_imported():
        raise InvalidInputError(
            "parameter pose_source: got 'tf' without tf2_ros, expected 'odom' or 'topic'"
        )
    need_nav2 = [source.name for source in settings.sources if source.filter_info_topic]
    if need_nav2 and optional.nav2("CostmapFilterInfo") is None:
        raise InvalidInputError(
            f"parameter {need_nav2[0]}.filter_info_topic: got it without nav2_msgs, expected "
            "topic, with base and multiplier by parameter"
        )


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the description of a parameter that ROS's tools show."""
    descriptor = ParameterDescriptor(description=parameter.about, dynamic_typing=True)
    if parameter.choices:
        descriptor.additional_constraints = f"one of {', '.join(parameter.choices)}"
    low, high = float(parameter.low), min(float(parameter.high), sys.float_info.max)
    if parameter.kind is float and math.isfinite(low):
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


def spin(arguments: list[str], *, autostart: bool) -> None:
    """Run the node with arguments for ROS until it is interrupted.

    With `autostart` it configures and activates itself; else a lifecycle manager does that.

    Raises:
        InvalidInputError: if it configures itself and a parameter does not fit.
    """
    warnings.simplefilter("ignore", SafetyWarning)  # the diagnostics show the same
    sys.setswitchinterval(SWITCH_INTERVAL)

    def begin(node: FilterNode) -> None:
        if autostart and node.trigger_configure() != DONE:
            raise InvalidInputError("the node is not configured, see the line above")
        if autostart:
            node.trigger_activate()

    def end(node: FilterNode) -> None:
        if node.is_active:
            node.trigger_deactivate()

    running.run(FilterNode, arguments, begin, end)
