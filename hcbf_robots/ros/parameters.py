"""The node's parameters: one table, from which it declares them, reads them and is documented.

Names, meanings and defaults are those of Nav2's collision monitor wherever it has one of the same
meaning. A value that does not fit is refused by its name before the node is active.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hcbf_gym import programs
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.errors import InvalidInputError, check_options, shown
from hcbf_gym.models.clocks import AHEAD
from hcbf_robots.ros.parameter import Parameter, parameter, table

GRIDS = ("map", "keepout", "speed")
"""Types of sources that are occupancy grids."""
ZONES = ("polygon", "circle")
"""Types of sources that are one region, which may come, move and go."""
TYPES = ("scan", *GRIDS, *ZONES)


def stamped_by_default() -> bool:
    """Return whether the running distribution's velocities have a header: all but Jazzy's."""
    return os.environ.get("ROS_DISTRO", "kilted") not in ("humble", "iron", "jazzy")


@dataclass(frozen=True)
class SourceSettings:
    """What stands before a source's name and a dot: ``<source>.type`` and so on."""

    name: str = field(metadata={})
    type: str = parameter("scan", "what it is", choices=TYPES)
    enabled: bool = parameter(True, "whether it counts", live=True)
    topic: str = parameter("", "it is heard from; of a polygon or circle, messages replace it")
    file: str = parameter("", "of a grid: a map server's YAML, in the place of a topic")
    priority: int = parameter(1, "its rank; 1 is the highest and strict", low=1, high=LOWEST_RANK)
    margin: float = parameter(0.0, "reserved around it [m]", low=0.0, high=100.0)
    when_inside: str = parameter(
        "leave",
        "the robot in it drives out by its rank, or stops",
        choices=("leave", "stop"),
    )
    source_timeout: float = parameter(
        -1.0, "[s]; 0: never stale; −1: source_timeout of a scan, never of the others", low=-1.0
    )
    frame_id: str = parameter("", 'of its messages; "": base_frame_id of a scan, else the map\'s')
    mount: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "of a scan: x, y [m] and yaw [rad] of the sensor on the robot, without tf"
    )
    scan_period: float = parameter(
        0.1, "of a scan: how old it is at most when the next one comes [s]", low=0.0, high=10.0
    )
    obstacle_speed: float = parameter(
        0.0,
        "of a scan: the fastest thing around [m/s], reserved for its age, at least scan_period",
        low=0.0,
        high=10,
    )
    range_noise: float = parameter(
        0.0, "of a scan: what a range is off by at most [m], reserved", low=0.0, high=1.0
    )
    unknown: int = parameter(
        1, "of a map: rank of unknown cells and the outside; 0: free", low=0, high=LOWEST_RANK
    )
    filter_info_topic: str = parameter(
        "", "of a mask: CostmapFilterInfo, where nav2_msgs can be imported"
    )
    base: float = parameter(
        100.0, "of a speed mask: limit = base + multiplier · value", low=-1e4, high=1e4
    )
    multiplier: float = parameter(-1.0, "of a speed mask", low=-1e4, high=1e4)
    percent: bool = parameter(True, "of a speed mask: limits are % of the greatest speed, or m/s")
    points: tuple[float, ...] = parameter((), "of a polygon: x and y of each corner [m]")
    center: tuple[float, ...] = parameter((), "of a circle [m]")
    radius: float = parameter(0.0, "of a circle [m]", low=0.0, high=1e4)


@dataclass(frozen=True)
class Settings:
    """All parameters."""

    base_frame_id: str = parameter("base_footprint", "the robot's frame")
    odom_frame_id: str = parameter("odom", "the odometry's frame")
    global_frame_id: str = parameter("odom", "the frame of maps and zones, and of the pose")
    pose_source: str = parameter(
        "odom",
        "the pose is the odometry's, a pose topic's, or tf's where tf2 can be imported",
        choices=("odom", "topic", "tf"),
    )
    cmd_vel_in_topic: str = parameter("cmd_vel_smoothed", "the velocity wanted")
    cmd_vel_out_topic: str = parameter("cmd_vel", "the velocity given")
    enable_stamped_cmd_vel: bool = parameter(
        stamped_by_default, "TwistStamped, or Twist; false in Jazzy, true in later distributions"
    )
    odom_topic: str = parameter("odom", "nav_msgs/Odometry")
    pose_topic: str = parameter("pose", "PoseWithCovarianceStamped, for pose_source topic")
    goal_topic: str = parameter("goal_pose", "PoseStamped, where guidance leads")
    state_topic: str = parameter("", 'the collision monitor\'s state; "": none')
    transform_tolerance: float = parameter(
        AHEAD, "by which a stamp may be ahead of the clock [s]", low=0.0, high=10.0
    )
    source_timeout: float = parameter(2.0, "of scans [s]; 0: never stale", low=0.0, high=60.0)
    cmd_vel_timeout: float = parameter(0.25, "of the velocity wanted [s]", low=0.01, high=10.0)
    odom_timeout: float = parameter(0.2, "of odometry and pose [s]", low=0.01, high=10.0)
    clock_timeout: float = parameter(
        0.15, "how long the node's clock may stand still [s of the steady clock]", low=0.01, high=60
    )
    stop_pub_timeout: float = parameter(
        1.0, "after so long at zero nothing is published [s]", low=0.0, high=3600.0
    )
    pose_jump: float = parameter(
        0.25, "by which a pose may differ from the twist [m]", low=0.01, high=100.0
    )
    settle_time: float = parameter(0.2, "at zero after a jump of the pose [s]", low=0.0, high=60.0)
    alarm_pause: float = parameter(
        2.0, "at zero after an alarm: the robot did not follow its commands [s]", low=0.0, high=3600
    )
    base_shift_correction: bool = parameter(
        True, "whether a scan is placed by the pose at its stamp, or by the newest"
    )
    enabled: bool = parameter(
        True, "false passes velocities on as they are; ~/toggle sets it", live=True
    )
    observation_sources: tuple[str, ...] = parameter((), "names of the sources")
    robot: str = parameter("", 'a contract\'s path or name; "": the next seven describe the robot')
    max_forward: float = parameter(0.0, "greatest speed ahead and back [m/s]", low=0.0, high=100.0)
    max_turn: float = parameter(0.0, "greatest turning rate [rad/s]", low=0.0, high=100.0)
    max_sideways: float = parameter(
        0.0, "greatest speed to either side [m/s]; 0: a differential drive", low=0.0, high=100.0
    )
    look_ahead: float = parameter(
        0.0, "of a differential drive: of the point before its axle [m]", low=0.0, high=100.0
    )
    reach: float = parameter(
        0.0, "radius of the circle around the centre, or axle, that holds it [m]", low=0.0, high=100
    )
    footprint: str = parameter(
        "", "its outline as Nav2 writes it, [[x, y], …]: reach becomes no less than holds it"
    )
    response_file: str = parameter("", 'from hcbf identify; "": the margins of a slow robot')
    program: str = parameter("lex-cbf-qp", "which ranked program", choices=programs.names())
    period: float = parameter(
        0.05, "after so long without a new one, the velocity is filtered again [s]",
        low=0.005, high=0.15,
    )  # fmt: skip
    v_max: float = parameter(
        0.0, "strict cap on the speed [m/s]; 0: none", low=0.0, high=100.0, live=True
    )
    guidance: str = parameter(
        "", "towards the goal, round what is known", choices=("", "geodesic", "local")
    )
    use_bond: str = parameter(
        "auto", "with the lifecycle manager, where bondpy can be imported", choices=("auto", "no")
    )
    sources: tuple[SourceSettings, ...] = field(default=(), metadata={})


OF_NODE = table(Settings)
OF_SOURCE = table(SourceSettings)
FOREIGN = ("use_sim_time", "qos_overrides", "start_type_description_service")
"""Parameters that ROS declares in every node; what begins like one of these is not ours."""


def by_name(sources: Sequence[str]) -> dict[str, Parameter]:
    """Return all parameters of a node with such sources, by their whole names."""
    found = {one.name: one for one in OF_NODE}
    for name in sources:
        found |= {f"{name}.{one.name}": one for one in OF_SOURCE}
    return found


def read(given: Mapping[str, object]) -> Settings:
    """Return the settings that parameters make; what is not given has its default.

    Args:
        given: whole name → value, as a node or a file has them.

    Raises:
        InvalidInputError: if a name is unknown, or a value does not fit; the message names it.
    """
    given = {name: value for name, value in given.items() if name.split(".")[0] not in FOREIGN}
    whole = {one.name: one for one in OF_NODE}
    listed = given.get("observation_sources", ())
    sources = whole["observation_sources"].read(listed, "observation_sources")
    bad = [name for name in sources if not name.isidentifier() or name in whole]
    if bad or len(set(sources)) < len(sources):
        raise InvalidInputError(
            f"parameter observation_sources: got {list(sources)}, expected different names of "
            "letters, digits and _, none of them a parameter's"
        )
    known = by_name(sources)
    check_options("parameters", given, known)
    values = {name: known[name].read(value, name) for name, value in given.items()}
    made = []
    for name in sources:
        own = {one.name: values.pop(f"{name}.{one.name}", one.default) for one in OF_SOURCE}
        made.append(_checked_source(SourceSettings(name, **own)))
    return _checked(Settings(**values, sources=tuple(made)))


_BELONGS = {
    "mount": ("scan",),
    "scan_period": ("scan",),
    "obstacle_speed": ("scan",),
    "range_noise": ("scan",),
    "file": GRIDS,
    "unknown": ("map",),
    "filter_info_topic": ("keepout", "speed"),
    "base": ("speed",),
    "multiplier": ("speed",),
    "percent": ("speed",),
    "points": ("polygon",),
    "center": ("circle",),
    "radius": ("circle",),
}
"""Parameters of a source that are of some types alone."""


def _checked_source(one: SourceSettings) -> SourceSettings:
    """Return a source's settings.

    Raises:
        InvalidInputError: if they do not go together; the message names the parameter.
    """
    label = f"parameter {one.name}."
    if -1.0 < one.source_timeout < 0.0:
        raise InvalidInputError(
            f"{label}source_timeout: got {one.source_timeout:g}, expected −1 or a number ≥ 0"
        )
    defaults = {parameter.name: parameter.default for parameter in OF_SOURCE}
    for name, types in _BELONGS.items():
        if getattr(one, name) != defaults[name] and one.type not in types:
            raise InvalidInputError(
                f"{label}{name}: got it where {one.name}.type is {one.type!r}, expected it for "
                f"{' or '.join(types)} alone"
            )
    lengths = {
        "mount": len(one.mount) == 3,
        "points": len(one.points) % 2 == 0 and len(one.points) != 2 and len(one.points) != 4,
        "center": len(one.center) in (0, 2),
    }
    for name, fits in lengths.items():
        if not fits:
            raise InvalidInputError(
                f"{label}{name}: got {list(getattr(one, name))}, expected "
                f"{'x, y, yaw' if name == 'mount' else 'x and y of each, three corners or more'}"
            )
    placed = one.points if one.type == "polygon" else one.center
    if one.type in ZONES and not placed and not one.topic:
        place = "points" if one.type == "polygon" else "center"
        raise InvalidInputError(f"{label}{place}: is missing, expected it or a topic")
    if one.type == "circle" and one.center and one.radius <= 0.0:
        raise InvalidInputError(f"{label}radius: got {one.radius:g}, expected a number > 0")
    ways = [name for name in ("topic", "file", "filter_info_topic") if getattr(one, name)]
    if one.type not in ZONES and len(ways) != 1:
        expected = "topic" if one.type == "scan" else "one of topic, file and filter_info_topic"
        got = " beside ".join(f"{one.name}.{way}" for way in ways[::-1])
        raise InvalidInputError(
            f"parameter {got or one.name + '.topic: nothing'}: got it for a {one.type}, expected "
            f"{expected}"
        )
    _check_topics(label, {"topic": one.topic, "filter_info_topic": one.filter_info_topic})
    if one.type == "speed" and one.when_inside == "stop":
        raise InvalidInputError(
            f"{label}when_inside: got 'stop' for a speed mask, expected 'leave': it is crossed"
        )
    return one


_TOPIC = re.compile(r"(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def _check_topics(label: str, topics: Mapping[str, str]) -> None:
    """Refuse what ROS takes for no topic's name; "" is none.

    Args:
        label: stands before the parameters' names.
        topics: of each parameter; where ROS shall put {node} or {ns}, a letter stands for it.

    Raises:
        InvalidInputError: the message names the parameter.
    """
    for name, topic in topics.items():
        if topic and not _TOPIC.fullmatch(re.sub(r"\{(node|ns|namespace)\}", "n", topic)):
            raise InvalidInputError(
                f"{label}{name}: got {shown(topic)}, expected a topic: letters, digits and _, with "
                "/ between its parts, none of which begins with a digit"
            )


def _checked(settings: Settings) -> Settings:
    """Return the settings.

    Raises:
        InvalidInputError: if they do not go together; the message names the parameter.
    """
    if settings.pose_source == "odom" and settings.global_frame_id != settings.odom_frame_id:
        raise InvalidInputError(
            f"parameter global_frame_id: got {settings.global_frame_id!r} with pose_source 'odom', "
            f"expected odom_frame_id, {settings.odom_frame_id!r}, or pose_source 'topic' or 'tf'"
        )
    for one in settings.sources:
        if one.type != "scan" and one.frame_id not in ("", settings.global_frame_id):
            raise InvalidInputError(
                f"parameter {one.name}.frame_id: got {one.frame_id!r} for a {one.type}, expected "
                f"global_frame_id, {settings.global_frame_id!r}: nothing moves maps and zones there"
            )
    described = (
        "max_forward", "max_turn", "max_sideways", "look_ahead", "reach", "footprint",
        "response_file",
    )  # fmt: skip
    beside = [name for name in described if getattr(settings, name)]
    if settings.robot and beside:
        raise InvalidInputError(
            f"parameter {beside[0]}: got it beside robot {settings.robot!r}, expected it without"
        )
    if not settings.robot:
        for name in ("max_forward", "max_turn"):
            if getattr(settings, name) <= 0.0:
                raise InvalidInputError(
                    f"parameter {name}: is missing, expected a number > 0, or a contract as robot"
                )
        if (settings.max_sideways > 0.0) == (settings.look_ahead > 0.0):
            raise InvalidInputError(
                f"parameter look_ahead: got {settings.look_ahead:g} and max_sideways "
                f"{settings.max_sideways:g}, expected one of them above 0: look_ahead of a "
                "differential drive, max_sideways where the robot moves in every direction"
            )
    if settings.cmd_vel_timeout < settings.period:
        raise InvalidInputError(
            f"parameter cmd_vel_timeout: got {settings.cmd_vel_timeout:g}, expected at least the "
            f"period, {settings.period:g}"
        )
    topics = {one.name: getattr(settings, one.name) for one in OF_NODE if "_topic" in one.name}
    _check_topics("parameter ", topics)
    for name, topic in topics.items():
        if not topic and name != "state_topic":
            raise InvalidInputError(f"parameter {name}: got '', expected a topic")
    if settings.cmd_vel_in_topic == settings.cmd_vel_out_topic:
        raise InvalidInputError(
            f"parameter cmd_vel_out_topic: got {settings.cmd_vel_out_topic!r}, expected another "
            "than cmd_vel_in_topic"
        )
    return settings
