"""The lifecycle node: messages in, what `core` decides out. It needs rclpy.

Commands, odometry and the periods of the filter are handled by the executor's thread. Scans, maps,
zones and guidance's field are prepared in another one and handed over under a lock that is held for
microseconds.
"""

import contextlib
import functools
import sys
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
import rclpy.exceptions
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    PointStamped,
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
)
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from hcbf_gym.errors import HcbfError, InvalidInputError, SafetyWarning
from hcbf_gym.ros import markers, messages, optional, sources
from hcbf_gym.ros.core import Decision, NodeCore
from hcbf_gym.ros.parameters import Parameter, by_name, read
from hcbf_gym.ros.sources import Entries
from hcbf_gym.ros.watches import Now
from hcbf_gym.ros.worker import Worker

NAME = "hcbf_filter"

RELIABLE = QoSProfile(depth=10)
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MASK = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)

SHOWN_EVERY = 0.2
"""Of the markers, while anybody looks at them [s]."""
SWITCH = 2e-4
"""After which Python lets the other thread go on [s]."""

DONE, REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class FilterNode(LifecycleNode):
    """The node; see docs/ros.md for its topics, services and parameters.

    Args:
        **options: as `rclpy.node.Node` takes them.
    """

    def __init__(self, **options: Any):
        super().__init__(NAME, automatically_declare_parameters_from_overrides=True, **options)
        self._core: NodeCore | None = None
        self._worker: Worker | None = None
        self._lock = threading.Lock()
        self._active = False
        self._entities: list[Any] = []
        self._bond: Any = None
        self._shown = self._told = ("", "")
        self._latency = self._slowest = 0.0
        self._decision: Decision | None = None
        self._header: Any = None
        self._marked = 0.0
        self._limits: dict[str, dict[str, Any]] = {}
        self._masks: dict[str, Any] = {}
        self._declare()
        self.add_on_set_parameters_callback(self._on_parameters)

    # -- parameters -------------------------------------------------------------------------------

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
                # a value that does not fit: `configure` says so by its name
                with contextlib.suppress(rclpy.exceptions.ParameterException):
                    self.set_descriptor(name, _descriptor(one))

    def _on_parameters(self, changed: list[Any]) -> SetParametersResult:
        """Take what may change while the node runs, and refuse what does not fit."""
        if self._core is None:
            return SetParametersResult(successful=True)  # `configure` reads them all
        known = by_name(list(self._core.sources))
        try:
            for one in changed:
                if one.name in known:
                    self._set(known[one.name], one.name, one.value)
        except InvalidInputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _set(self, parameter: Parameter, name: str, given: Any) -> None:
        """Set one parameter.

        Raises:
            InvalidInputError: if it does not fit, or may not change now.
        """
        value = parameter.read(given, name)
        if not parameter.live:
            raise InvalidInputError(
                f"parameter {name}: got {given!r} while the node is configured, expected it before"
            )
        with self._lock:
            core = self._configured
            if name == "enabled":
                core.enabled = value
            elif name == "v_max":
                core.set_v_max(value)
            else:
                core.enable_source(name.split(".")[0], value)

    # -- lifecycle --------------------------------------------------------------------------------

    @property
    def _configured(self) -> NodeCore:
        assert self._core is not None
        return self._core

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Read the parameters and compile; a value or a file that does not fit is FAILURE."""
        try:
            settings = read(self._given())
            if settings.pose_source == "tf" and not optional.Transforms.can_be():
                raise InvalidInputError(
                    "parameter pose_source: got 'tf' where tf2_ros cannot be imported, expected "
                    "'odom' or 'topic'"
                )
            needs_info = [one.name for one in settings.sources if one.filter_info_topic]
            if needs_info and optional.filter_info() is None:
                raise InvalidInputError(
                    f"parameter {needs_info[0]}.filter_info_topic: got it where nav2_msgs cannot "
                    "be imported, expected topic, with base and multiplier by parameter"
                )
            self._core = NodeCore(settings)
        except HcbfError as error:
            self.get_logger().error(f"configure: {error}")
            return REFUSED
        self._worker = Worker()
        self._transforms = optional.Transforms(self) if optional.Transforms.can_be() else None
        self._publishers_of(settings)
        self._subscriptions_of(settings)
        kind = optional.toggle()
        self._entities.append(self.create_service(kind or SetBool, "~/toggle", self._on_toggle))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(settings.period, self._on_period, clock=steady)
        self._slow_timer = self.create_timer(1.0, self._diagnose, clock=steady)
        self._entities += [self._timer, self._slow_timer]
        return super().on_configure(state)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin to publish."""
        done = super().on_activate(state)
        self._active = True
        if self._configured.settings.use_bond == "auto":
            self._bond = optional.bond(self, self.get_name())
        return done

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Say zero once more, and nothing after it."""
        if self._active:
            self._publish(np.zeros(3))
        self._active = False
        self._break_bond()
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Forget what was configured."""
        self._clean()
        return super().on_cleanup(state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Say zero if the node was active, and end."""
        if self._active:
            self._publish(np.zeros(3))
        self._active = False
        self._break_bond()
        self._clean()
        return super().on_shutdown(state)

    def _break_bond(self) -> None:
        if self._bond is not None:
            self._bond.break_bond()
            self._bond = None

    def _clean(self) -> None:
        if self._worker is not None:
            self._worker.close()
        self._worker = self._core = None
        destroy = {"Timer": self.destroy_timer, "Service": self.destroy_service}
        for one in self._entities:
            kind = type(one).__name__
            if kind == "LifecyclePublisher":
                self.destroy_lifecycle_publisher(one)
            else:
                destroy.get(kind, self.destroy_subscription)(one)
        self._entities = []

    # -- topics -----------------------------------------------------------------------------------

    def _publishers_of(self, settings: Any) -> None:
        """Create what the node publishes."""
        kind = TwistStamped if settings.enable_stamped_cmd_vel else Twist
        self._stamped = settings.enable_stamped_cmd_vel
        self._state_kind = optional.state_message() or KeyValue

        def publisher(kind: Any, topic: str) -> Any:
            made = self.create_lifecycle_publisher(kind, topic, RELIABLE)
            self._entities.append(made)
            return made

        self._velocity = publisher(kind, settings.cmd_vel_out_topic)
        self._diagnostics = publisher(DiagnosticArray, "/diagnostics")
        self._report = publisher(DiagnosticArray, "~/report")
        self._markers = publisher(MarkerArray, "~/markers")
        topic = settings.state_topic
        self._state = publisher(self._state_kind, topic) if topic else None

    def _subscriptions_of(self, settings: Any) -> None:
        """Create what the node hears."""

        def hear(kind: Any, topic: str, callback: Callable[..., None], qos: QoSProfile) -> None:
            self._entities.append(self.create_subscription(kind, topic, callback, qos))

        if self._stamped:
            hear(TwistStamped, settings.cmd_vel_in_topic, self._on_stamped, RELIABLE)
        else:
            hear(Twist, settings.cmd_vel_in_topic, self._on_twist, RELIABLE)
        hear(Odometry, settings.odom_topic, self._on_odometry, SENSOR)
        if settings.pose_source == "topic":
            hear(PoseWithCovarianceStamped, settings.pose_topic, self._on_pose, RELIABLE)
        if settings.guidance:
            hear(PoseStamped, settings.goal_topic, self._on_goal, RELIABLE)
        kinds: dict[str, Any] = {
            "scan": (LaserScan, self._on_scan, SENSOR),
            "map": (OccupancyGrid, self._on_grid, LATCHED),
            "keepout": (OccupancyGrid, self._on_grid, MASK),
            "speed": (OccupancyGrid, self._on_grid, LATCHED),
            "polygon": (PolygonStamped, self._on_polygon, RELIABLE),
            "circle": (PointStamped, self._on_circle, RELIABLE),
        }
        for one in settings.sources:
            kind, callback, qos = kinds[one.type]
            if one.topic:
                hear(kind, one.topic, functools.partial(callback, one.name), qos)
            if one.filter_info_topic:
                told = functools.partial(self._on_filter_info, one.name)
                hear(optional.filter_info(), one.filter_info_topic, told, LATCHED)

    def _now(self) -> Now:
        return Now(1e-9 * self.get_clock().now().nanoseconds, time.monotonic())

    # -- the path of a command --------------------------------------------------------------------

    def _on_twist(self, message: Any) -> None:
        self._hear_command(message, None, "")

    def _on_stamped(self, message: Any) -> None:
        stamp = messages.seconds(message.header.stamp)
        self._header = message.header
        self._hear_command(message.twist, stamp or None, message.header.frame_id)

    def _hear_command(self, twist: Any, stamp: float | None, frame: str) -> None:
        if not self._active:
            return
        begun, now = time.perf_counter(), self._now()
        with self._lock:
            self._configured.hear_command(messages.twist_of(twist), now, stamp, frame)
            decision = self._configured.step(now)
        self._do(decision)
        self._latency = time.perf_counter() - begun
        self._slowest = max(self._slowest, self._latency)
        self._timer.reset()
        self._say(decision, now)

    def _on_period(self) -> None:
        """Filter the last velocity again: none has come for a period."""
        if not self._active:
            return
        now = self._now()
        with self._lock:
            decision = self._configured.step(now)
        self._do(decision)
        self._say(decision, now)

    def _on_odometry(self, message: Any) -> None:
        now, core = self._now(), self._configured
        if self._transforms is not None and core.settings.pose_source == "tf":
            frames = core.settings.global_frame_id, core.settings.odom_frame_id
            found = self._transforms.newest(*frames)
            core.hear_correction(None if found is None else messages.transform_of(found.transform))
        with self._lock:
            core.hear_odometry(
                messages.pose_of(message.pose.pose),
                messages.twist_of(message.twist.twist),
                messages.seconds(message.header.stamp),
                now,
                message.header.frame_id,
                message.child_frame_id,
            )

    def _on_pose(self, message: Any) -> None:
        header = message.header
        with self._lock:
            self._configured.hear_pose(
                messages.pose_of(message.pose.pose),
                messages.seconds(header.stamp),
                self._now(),
                header.frame_id,
            )

    def _do(self, decision: Decision) -> None:
        """Publish a command, unless the node is silent."""
        if decision.command is not None:
            self._publish(decision.command)

    def _publish(self, command: Any) -> None:
        message: Any = TwistStamped() if self._stamped else Twist()
        if self._stamped and self._header is not None:
            message.header = self._header
        elif self._stamped:
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self._configured.settings.base_frame_id
        messages.write_twist(command, message.twist if self._stamped else message)
        self._velocity.publish(message)

    # -- what is prepared beside ------------------------------------------------------------------

    def _on_scan(self, name: str, message: Any) -> None:
        self._prepare(name, message.header, lambda: self._scan(name, message))

    def _scan(self, name: str, message: Any) -> Entries | None:
        core, frame = self._configured, message.header.frame_id
        mount = None
        if self._transforms is not None and frame != core.settings.base_frame_id:
            found = self._transforms.newest(core.settings.base_frame_id, frame)
            mount = None if found is None else messages.transform_of(found.transform)
        stamp = messages.seconds(message.header.stamp)
        return core.of_scan(name, messages.beams_of(message), stamp, mount)

    def _on_grid(self, name: str, message: Any) -> None:
        def shown() -> Entries:
            raster = messages.raster_of(message)
            return self._configured.of_grid(name, raster, self._limits.get(name))

        self._prepare(name, message.header, shown)

    def _on_filter_info(self, name: str, message: Any) -> None:
        """Hear the mask that the information names, in the place of the one before."""
        self._limits[name] = {
            "base": float(message.base),
            "multiplier": float(message.multiplier),
            "percent": message.type == 1,
        }
        heard = functools.partial(self._on_grid, name)
        if name in self._masks:
            self._entities.remove(self._masks[name])
            self.destroy_subscription(self._masks[name])
        topic = message.filter_mask_topic
        self._masks[name] = self.create_subscription(OccupancyGrid, topic, heard, MASK)
        self._entities.append(self._masks[name])

    def _on_polygon(self, name: str, message: Any) -> None:
        settings = self._configured.sources[name].settings
        corners = messages.corners_of(message.polygon)
        self._prepare(name, message.header, lambda: sources.of_polygon(settings, corners))

    def _on_circle(self, name: str, message: Any) -> None:
        """Take x and y of a point as the centre and z as the radius; 0 takes it away."""
        settings, at = self._configured.sources[name].settings, message.point
        shown = functools.partial(sources.of_circle, settings, (at.x, at.y), at.z)
        self._prepare(name, message.header, shown)

    def _prepare(self, name: str, header: Any, shown: Callable[[], Entries | None]) -> None:
        """Let the other thread make what a message shows, and hand it over."""
        stamp, frame = messages.seconds(header.stamp), header.frame_id

        def job() -> None:
            core = self._core
            if core is None:
                return
            try:
                made = shown()
                if made is None:
                    return
                planned = self._planned({name: made}) if _is_news(core, name, made) else None
            except (HcbfError, ValueError) as error:
                with self._lock:
                    core.refuse_source(name, str(error))
                return
            with self._lock:
                core.hear_source(name, made, stamp or self._now().ros, self._now(), frame)
                if planned is not None:
                    core.take(planned)

        assert self._worker is not None
        self._worker.put(name, job)

    def _planned(self, changed: dict[str, Entries]) -> Any:
        """Return a filter whose field knows of a change, or None without a goal."""
        core = self._configured
        if core.goal is None:
            return None
        try:
            return core.planned(core.goal, changed)
        except InvalidInputError as error:
            self.get_logger().warning(f"guidance ends: {error}")
            return core.planned(None, changed)

    def _on_goal(self, message: Any) -> None:
        goal, frame = messages.pose_of(message.pose)[:2], message.header.frame_id

        def job() -> None:
            core = self._core
            if core is None:
                return
            try:
                if frame != core.settings.global_frame_id:
                    raise InvalidInputError(
                        f"goal: got the frame {frame!r}, expected {core.settings.global_frame_id!r}"
                    )
                planned = core.planned(goal)
            except InvalidInputError as error:
                self.get_logger().warning(str(error))
                return
            with self._lock:
                core.take(planned)

        assert self._worker is not None
        self._worker.put("goal", job)

    # -- what is said -----------------------------------------------------------------------------

    def _on_toggle(self, request: Any, response: Any) -> Any:
        """Switch between filtering and passing on, by Nav2's Toggle or SetBool."""
        enable = request.enable if hasattr(request, "enable") else request.data
        with self._lock:
            self._configured.enabled = bool(enable)
        response.success, response.message = True, "enabled" if enable else "passes commands on"
        return response

    def _say(self, decision: Decision, now: Now) -> None:
        """Say what has changed, after the command is on its way."""
        self._decision = decision
        kind = decision.level.name, decision.says.split(":")[0]
        if kind != self._shown:
            self._shown = kind
            self._diagnose()
        told = decision.action.name, decision.name
        if told != self._told and self._state is not None:
            self._told = told
            self._state.publish(_state(self._state_kind, decision))
        if self._report.get_subscription_count() > 0:
            self._report.publish(self._reported(decision))
        if now.steady - self._marked > SHOWN_EVERY and self._markers.get_subscription_count() > 0:
            self._marked = now.steady
            stamp = self.get_clock().now().to_msg()
            self._markers.publish(markers.of(self._configured, decision, stamp))

    def _diagnose(self) -> None:
        """Publish the diagnostics: once a second, and on change."""
        decision = self._decision
        if not self._active or decision is None:
            return
        core, now = self._configured, self._now()
        silent = "" if decision.command is not None else " (silent)"
        status = DiagnosticStatus(
            level=bytes([decision.level]),
            name=f"{self.get_name()}: velocity filter",
            message=decision.says + silent,
            hardware_id=core.settings.robot or "robot",
        )
        values = {
            "latency": f"{self._latency:.6f}",
            "slowest": f"{self._slowest:.6f}",
            "fastest": f"{core.fastest:.3f}",
            "enabled": str(core.enabled).lower(),
        }
        for name, one in core.sources.items():
            fault = one.watch.fault(now)
            values[f"source {name}"] = "off" if not one.enabled else fault.says if fault else "ok"
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        self._slowest = 0.0
        self._diagnostics.publish(self._array(status))

    def _reported(self, decision: Decision) -> DiagnosticArray:
        """Return what the filter says of a step, for bags."""
        level = bytes([decision.level])
        status = DiagnosticStatus(level=level, name="report", message=decision.says)
        told = (
            np.full(len(decision.wanted), np.nan) if decision.command is None else decision.command
        )
        numbers = {"wanted": decision.wanted, "given": told, **(decision.report or {})}
        status.values = [
            KeyValue(key=key, value=" ".join(f"{n:.6g}" for n in np.atleast_1d(value)))
            for key, value in numbers.items()
        ]
        return self._array(status)

    def _array(self, status: DiagnosticStatus) -> DiagnosticArray:
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        return message


def _is_news(core: NodeCore, name: str, made: Entries) -> bool:
    """Return whether what a source shows changes guidance's field; a scan does not."""
    source = core.sources[name]
    return source.settings.type != "scan" and list(map(id, made)) != list(map(id, source.entries))


def _state(kind: Any, decision: Decision) -> Any:
    """Return the collision monitor's state, or its two fields as key and value without Nav2."""
    if kind is KeyValue:
        return KeyValue(key=decision.action.name, value=decision.name)
    return kind(action_type=int(decision.action), polygon_name=decision.name)


def _descriptor(one: Parameter) -> ParameterDescriptor:
    """Return what ROS's tools show of a parameter."""
    made = ParameterDescriptor(description=one.says, dynamic_typing=True)
    if one.choices:
        made.additional_constraints = f"one of {', '.join(one.choices)}"
    if one.kind is float and one.low is not None:
        high = float(sys.float_info.max if one.high is None else one.high)
        made.floating_point_range = [FloatingPointRange(from_value=float(one.low), to_value=high)]
    return made


def executor_of(context: Any = None) -> Any:
    """Return the executor of events where there is one, and else that of one thread."""
    events = optional.found("rclpy.experimental", "EventsExecutor")
    if events is None:
        events = optional.found("rclpy.experimental.events_executor", "EventsExecutor")
    if events is not None:
        return events.EventsExecutor(context=context)
    from rclpy.executors import SingleThreadedExecutor

    return SingleThreadedExecutor(context=context)


def spin(arguments: list[str], *, autostart: bool) -> None:
    """Run the node until it is interrupted.

    Args:
        arguments: for ROS.
        autostart: whether it configures and activates itself; else a lifecycle manager does.

    Raises:
        InvalidInputError: if it configures itself and a parameter does not fit.
    """
    warnings.simplefilter("ignore", SafetyWarning)  # the diagnostics say all of it, every time
    sys.setswitchinterval(SWITCH)
    try:
        rclpy.init(args=arguments)
    except Exception as error:  # rclpy raises kinds of its own for what its parser refuses
        raise InvalidInputError(
            f"ROS refuses the arguments or the parameter file: {error}"
        ) from error
    node = FilterNode()
    executor = executor_of()
    executor.add_node(node)
    try:
        if autostart:
            if node.trigger_configure() != DONE:
                raise InvalidInputError("the node is not configured, see the line above")
            node.trigger_activate()
        executor.spin()
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        if node._active and rclpy.ok():
            node.trigger_deactivate()
        node.destroy_node()
        rclpy.try_shutdown()
