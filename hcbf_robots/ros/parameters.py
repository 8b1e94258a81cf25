"""The node's parameters: one table, from which it declares them, reads them and is documented.

Names, meanings and defaults are those of Nav2's collision monitor wherever it has one of the same
meaning. An invalid value is refused by its name before the node is active.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hcbf_gym import programs
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.errors import InvalidInputError, check_options, shown
from hcbf_gym.models.clocks import AHEAD
from hcbf_robots.ros.parameter import Parameter, parameter, table

GRIDS = ("map", "keepout", "speed")
"""Types of sources that are occupancy grids."""
PLACES = {"polygon": "points", "circle": "center"}
"""Types of sources that are one region, which may come, move and go → where it is."""
TYPES = ("scan", *GRIDS, *PLACES)


def stamped_by_default() -> bool:
    """Return whether the running distribution's velocities have a header: all but Jazzy's."""
    return os.environ.get("ROS_DISTRO", "kilted") not in ("humble", "iron", "jazzy")


@dataclass(frozen=True)
class SourceSettings:
    """Parameters behind a source's name and a dot: ``<source>.type`` and so on."""

    name: str
    type: str = parameter("scan", "what it is", choices=TYPES)
    enabled: bool = parameter(True, "whether it counts", live=True)
    topic: str = parameter("", "it is heard from; of a polygon or circle, messages replace it")
    file: str = parameter("", "of a grid: a map server's YAML, in the place of a topic")
    priority: int = parameter(1, "its rank; 1 is the highest and strict", 1, LOWEST_RANK)
    margin: float = parameter(0.0, "reserved around it [m]", 0.0, 100.0)
    when_inside: str = parameter(
        "leave", "the robot in it drives out by its rank, or stops", choices=("leave", "stop")
    )
    source_timeout: float = parameter(
        -1.0, "[s]; 0: never stale; −1: source_timeout of a scan, never of the others", -1.0
    )
    frame_id: str = parameter("", 'of its messages; "": base_frame_id of a scan, else the map\'s')
    mount: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "of a scan: x, y [m] and yaw [rad] of the sensor on the robot, without tf"
    )
    scan_period: float = parameter(
        0.1, "of a scan: how old it is at most when the next one comes [s]", 0.0, 10.0
    )
    obstacle_speed: float = parameter(
        0.0,
        "of a scan: the fastest thing around [m/s], reserved for its age, at least scan_period",
        0.0,
        10,
    )
    range_noise: float = parameter(
        0.0, "of a scan: what a range is off by at most [m], reserved", 0.0, 1.0
    )
    unknown: int = parameter(
        1, "of a map: rank of unknown cells and the outside; 0: free", 0, LOWEST_RANK
    )
    filter_info_topic: str = parameter(
        "", "of a mask: CostmapFilterInfo, where nav2_msgs can be imported"
    )
    base: float = parameter(100.0, "of a speed mask: limit = base + multiplier · value", -1e4, 1e4)
    multiplier: float = parameter(-1.0, "of a speed mask", -1e4, 1e4)
    percent: bool = parameter(True, "of a speed mask: limits are % of the greatest speed, or m/s")
    points: tuple[float, ...] = parameter((), "of a polygon: x and y of each corner [m]")
    center: tuple[float, ...] = parameter((), "of a circle [m]")
    radius: float = parameter(0.0, "of a circle [m]", 0.0, 1e4)


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
        AHEAD, "by which a stamp may be ahead of the clock [s]", 0.0, 10.0
    )
    source_timeout: float = parameter(2.0, "of scans [s]; 0: never stale", 0.0, 60.0)
    cmd_vel_timeout: float = parameter(0.25, "of the velocity wanted [s]", 0.01, 10.0)
    odom_timeout: float = parameter(0.2, "of odometry and pose [s]", 0.01, 10.0)
    clock_timeout: float = parameter(
        0.15, "how long the node's clock may stand still [s of the steady clock]", 0.01, 60
    )
    stop_pub_timeout: float = parameter(
        1.0, "after so long at zero nothing is published [s]", 0.0, 3600.0
    )
    pose_jump: float = parameter(0.25, "by which a pose may differ from the twist [m]", 0.01, 100.0)
    settle_time: float = parameter(0.2, "at zero after a jump of the pose [s]", 0.0, 60.0)
    alarm_pause: float = parameter(
        2.0, "at zero after an alarm: the robot did not follow its commands [s]", 0.0, 3600
    )
    base_shift_correction: bool = parameter(
        True, "whether a scan is placed by the pose at its stamp, or by the newest"
    )
    enabled: bool = parameter(
        True, "false passes velocities on as they are; ~/toggle sets it", live=True
    )
    observation_sources: tuple[str, ...] = parameter((), "names of the sources")
    robot: str = parameter("", 'a contract\'s path or name; "": the next seven describe the robot')
    max_forward: float = parameter(0.0, "greatest speed ahead and back [m/s]", 0.0, 100.0)
    max_turn: float = parameter(0.0, "greatest turning rate [rad/s]", 0.0, 100.0)
    max_sideways: float = parameter(
        0.0, "greatest speed to either side [m/s]; 0: a differential drive", 0.0, 100.0
    )
    look_ahead: float = parameter(
        0.0, "of a differential drive: of the point before its axle [m]", 0.0, 100.0
    )
    reach: float = parameter(
        0.0, "radius of the circle around the centre, or axle, that holds it [m]", 0.0, 100
    )
    footprint: str = parameter(
        "", "its outline as Nav2 writes it, [[x, y], …]: reach becomes no less than holds it"
    )
    response_file: str = parameter("", 'from hcbf identify; "": the margins of a slow robot')
    program: str = parameter("lex-cbf-qp", "which ranked program", choices=programs.names())
    period: float = parameter(
        0.05,
        "after so long without a new one, the velocity is filtered again [s]",
        0.005,
        0.15,
    )
    v_max: float = parameter(0.0, "strict cap on the speed [m/s]; 0: none", 0.0, 100.0, live=True)
    guidance: str = parameter(
        "", "towards the goal, round what is known", choices=("", "geodesic", "local")
    )
    use_bond: str = parameter(
        "auto", "with the lifecycle manager, where bondpy can be imported", choices=("auto", "no")
    )
    sources: tuple[SourceSettings, ...] = ()


OF_NODE = table(Settings)
OF_SOURCE = table(SourceSettings)
FOREIGN = ("use_sim_time", "qos_overrides", "start_type_description_service")
"""First parts of the parameters that ROS declares in every node."""
DESCRIBED = (
    "max_forward", "max_turn", "max_sideways", "look_ahead", "reach", "footprint", "response_file",
)  # fmt: skip
"""Parameters that describe a robot without a contract."""
BELONGS = {
    **dict.fromkeys(("mount", "scan_period", "obstacle_speed", "range_noise"), ("scan",)),
    **dict.fromkeys(("base", "multiplier", "percent"), ("speed",)),
    **dict.fromkeys(("center", "radius"), ("circle",)),
    "points": ("polygon",),
    "file": GRIDS,
    "unknown": ("map",),
    "filter_info_topic": ("keepout", "speed"),
}
"""Parameters of a source that are of some types alone."""
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def by_name(sources: Sequence[str]) -> dict[str, Parameter]:
    """Return all parameters of a node with such sources, by their whole names."""
    found = {one.name: one for one in OF_NODE}
    return found | {f"{name}.{one.name}": one for name in sources for one in OF_SOURCE}


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
        made.append(SourceSettings(name, **own))
        _check_source(made[-1])
    settings = Settings(**values, sources=tuple(made))
    _check(settings)
    return settings


def _require(fits: bool, of: Settings | SourceSettings, name: str, expected: str) -> None:
    """Refuse settings by the whole name of one of their parameters unless it fits."""
    if not fits:
        whole = f"{of.name}.{name}" if isinstance(of, SourceSettings) else name
        got = shown(getattr(of, name))
        raise InvalidInputError(f"parameter {whole}: got {got}, expected {expected}")


def _check_source(one: SourceSettings) -> None:
    """Refuse settings of a source that do not fit one another."""
    timeout = one.source_timeout
    _require(timeout == -1.0 or timeout >= 0.0, one, "source_timeout", "−1 or a number ≥ 0")
    for own in OF_SOURCE:
        types = BELONGS.get(own.name, TYPES)
        fits = one.type in types or getattr(one, own.name) == own.default
        _require(fits, one, own.name, f"it where {one.name}.type is {' or '.join(types)}")
    _require(len(one.mount) == 3, one, "mount", "x, y, yaw")
    corners = len(one.points) not in (2, 4) and len(one.points) % 2 == 0
    _require(corners, one, "points", "x and y of each of three corners or more")
    _require(len(one.center) in (0, 2), one, "center", "x and y")
    place = PLACES.get(one.type)
    if place is not None:
        _require(bool(getattr(one, place) or one.topic), one, place, "it or a topic")
        _require(not one.center or one.radius > 0.0, one, "radius", "a number > 0")
    else:
        ways = ["topic"] if one.type == "scan" else ["topic", "file", "filter_info_topic"]
        given = [f"{one.name}.{name}" for name in ways if getattr(one, name)]
        if len(given) != 1:
            got = " and ".join(given) or f"no {one.name}.topic"
            raise InvalidInputError(
                f"parameter {one.name}.topic: got {got}, expected one of {', '.join(ways)}"
            )
    _check_topics(one, ("topic", "filter_info_topic"))
    leaves = one.type != "speed" or one.when_inside != "stop"
    _require(leaves, one, "when_inside", "'leave' of a speed mask, which is crossed")


def _check_topics(of: Settings | SourceSettings, names: Sequence[str]) -> None:
    """Refuse invalid names of topics; "" is none. ROS replaces {node} and {ns}."""
    for name in names:
        topic = re.sub(r"\{(node|ns|namespace)\}", "n", getattr(of, name))
        expected = "a topic: letters, digits and _, in parts that / separates and no digit begins"
        _require(not topic or _TOPIC.fullmatch(topic) is not None, of, name, expected)


def _check(settings: Settings) -> None:
    """Refuse settings of a node that do not fit one another."""

    def require(fits: Any, name: str, expected: str) -> None:
        _require(bool(fits), settings, name, expected)

    own, frame = settings.pose_source == "odom", settings.global_frame_id
    expected = f"odom_frame_id, {settings.odom_frame_id!r}, or pose_source 'topic' or 'tf'"
    require(not own or frame == settings.odom_frame_id, "global_frame_id", expected)
    for one in settings.sources:
        fits = one.type == "scan" or one.frame_id in ("", frame)
        _require(fits, one, "frame_id", f"global_frame_id, {frame!r}, for a {one.type}")
    if settings.robot:
        for name in DESCRIBED:
            require(not getattr(settings, name), name, f"nothing beside robot {settings.robot!r}")
    else:
        for name in ("max_forward", "max_turn"):
            expected = "a number > 0, or a contract as robot"
            require(getattr(settings, name) > 0.0, name, expected)
        is_one = (settings.max_sideways > 0.0) != (settings.look_ahead > 0.0)
        expected = (
            "a number > 0 of a differential drive, or max_sideways > 0 where the robot moves in "
            f"every direction: either, and not both (max_sideways is {settings.max_sideways:g})"
        )
        require(is_one, "look_ahead", expected)
    expected = f"at least the period, {settings.period:g}"
    require(settings.cmd_vel_timeout >= settings.period, "cmd_vel_timeout", expected)
    topics = [one.name for one in OF_NODE if one.name.endswith("_topic")]
    _check_topics(settings, topics)
    for name in topics:
        require(getattr(settings, name) or name == "state_topic", name, "a topic")
    differ = settings.cmd_vel_in_topic != settings.cmd_vel_out_topic
    require(differ, "cmd_vel_out_topic", "another than cmd_vel_in_topic")
