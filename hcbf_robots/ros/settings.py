"""The settings of the ROS node, one field a parameter: its default, meaning, range and choices.

A *source* gives the node regions: a laser scan, an occupancy grid (map, keepout mask or speed
mask), or one region (polygon or circle). Names, meanings and defaults are those of Nav2's
collision monitor wherever it has a parameter of the same meaning. Where a description begins with
types of sources, such as "scan:", only they have the parameter (`TYPES_OF_PARAMETER`).
"""

import os
from dataclasses import dataclass

from hcbf_gym import programs
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.models.clocks import AHEAD
from hcbf_robots.ros.parameter import parameter, parameters_of

GRIDS = ("map", "keepout", "speed")
"""Types of sources that are occupancy grids."""
PLACES = {"polygon": "points", "circle": "center"}
"""Type of a source that is one region → the parameter that places it; a message may move it."""
TYPES = ("scan", *GRIDS, *PLACES)


def stamped_by_default() -> bool:
    """Return whether the running distribution's velocities have a header: all but Jazzy's."""
    return os.environ.get("ROS_DISTRO", "kilted") not in ("humble", "iron", "jazzy")


@dataclass(frozen=True)
class SourceSettings:
    """Parameters of one source; ROS has them as ``<source>.type`` and so on."""

    name: str
    type: str = parameter("scan", "type of the source", choices=TYPES)
    enabled: bool = parameter(True, "whether the filter uses the source", live=True)
    topic: str = parameter("", "topic of its messages; those of a polygon or circle replace it")
    file: str = parameter("", "grids: YAML file of a map server, used instead of a topic")
    priority: int = parameter(
        1, "rank of its regions; 1 is the highest, and strict", 1, LOWEST_RANK
    )
    margin: float = parameter(0.0, "distance reserved around its regions [m]", 0.0, 100.0)
    when_inside: str = parameter(
        "leave", "a robot inside drives out by the rank, or stops", choices=("leave", "stop")
    )
    source_timeout: float = parameter(
        -1.0,
        "age at which it is stale [s]; 0: never; −1: source_timeout of a scan, never of others",
        -1.0,
    )
    frame_id: str = parameter(
        "", 'frame of its messages; "": base_frame_id for a scan, else global_frame_id'
    )
    mount: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "scan: x, y [m] and yaw [rad] of the sensor on the robot, without tf"
    )
    scan_period: float = parameter(0.1, "scan: its age when the next one comes [s]", 0.0, 10.0)
    obstacle_speed: float = parameter(
        0.0, "scan: fastest obstacle [m/s], reserved for its age, at least scan_period", 0.0, 10
    )
    range_noise: float = parameter(0.0, "scan: greatest error of a range, reserved [m]", 0.0, 1.0)
    unknown: int = parameter(
        1, "map: rank of unknown cells and of all outside it; 0: free", 0, LOWEST_RANK
    )
    filter_info_topic: str = parameter("", "masks: topic of CostmapFilterInfo, with nav2_msgs")
    base: float = parameter(100.0, "speed mask: limit = base + multiplier · value", -1e4, 1e4)
    multiplier: float = parameter(-1.0, "speed mask: see base", -1e4, 1e4)
    percent: bool = parameter(True, "speed mask: limits in % of the greatest speed, or m/s")
    points: tuple[float, ...] = parameter((), "polygon: x and y of each corner [m]")
    center: tuple[float, ...] = parameter((), "circle: x and y of its centre [m]")
    radius: float = parameter(0.0, "circle: its radius [m]", 0.0, 1e4)


@dataclass(frozen=True)
class Settings:
    """All parameters of the node, and of each of its sources."""

    base_frame_id: str = parameter("base_footprint", "frame of the robot")
    odom_frame_id: str = parameter("odom", "frame of the odometry")
    global_frame_id: str = parameter("odom", "frame of maps, zones and the pose")
    pose_source: str = parameter(
        "odom",
        "the pose comes from odometry, a pose topic, or tf, where tf2 can be imported",
        choices=("odom", "topic", "tf"),
    )
    cmd_vel_in_topic: str = parameter("cmd_vel_smoothed", "topic of the nominal velocity")
    cmd_vel_out_topic: str = parameter("cmd_vel", "topic of the filtered velocity")
    enable_stamped_cmd_vel: bool = parameter(
        stamped_by_default,
        "velocities are TwistStamped, or Twist; false in Jazzy, true in later distributions",
    )
    odom_topic: str = parameter("odom", "topic of nav_msgs/Odometry")
    pose_topic: str = parameter("pose", "PoseWithCovarianceStamped, for pose_source topic")
    goal_topic: str = parameter("goal_pose", "topic of PoseStamped, the goal of guidance")
    state_topic: str = parameter("", 'topic of the collision monitor\'s state; "": none')
    transform_tolerance: float = parameter(
        AHEAD, "time by which a stamp may be ahead of the clock [s]", 0.0, 10.0
    )
    source_timeout: float = parameter(2.0, "age at which a scan is stale [s]; 0: never", 0.0, 60.0)
    cmd_vel_timeout: float = parameter(
        0.25, "age at which the nominal velocity is stale [s]", 0.01, 10.0
    )
    odom_timeout: float = parameter(0.2, "age at which odometry or pose is stale [s]", 0.01, 10.0)
    clock_timeout: float = parameter(
        0.15, "time for which the node's clock may stop [s of the steady clock]", 0.01, 60
    )
    stop_pub_timeout: float = parameter(
        1.0, "time at zero velocity after which nothing is published [s]", 0.0, 3600.0
    )
    pose_jump: float = parameter(0.25, "greatest gap of pose and twist [m]", 0.01, 100.0)
    settle_time: float = parameter(0.2, "time at zero after a jump of the pose [s]", 0.0, 60.0)
    alarm_pause: float = parameter(
        2.0, "time at zero after an alarm: the robot did not follow its commands [s]", 0.0, 3600
    )
    base_shift_correction: bool = parameter(
        True, "true places a scan by the pose at its stamp, false by the newest"
    )
    enabled: bool = parameter(
        True, "false passes velocities on unchanged; ~/toggle sets it", live=True
    )
    observation_sources: tuple[str, ...] = parameter((), "names of the sources")
    robot: str = parameter(
        "", 'path or name of a contract; "": the next seven parameters describe the robot'
    )
    max_forward: float = parameter(0.0, "greatest speed ahead and back [m/s]", 0.0, 100.0)
    max_turn: float = parameter(0.0, "greatest turning rate [rad/s]", 0.0, 100.0)
    max_sideways: float = parameter(
        0.0, "greatest speed to either side [m/s]; 0: a differential drive", 0.0, 100.0
    )
    look_ahead: float = parameter(
        0.0, "differential drive: distance of the steered point before its axle [m]", 0.0, 100.0
    )
    reach: float = parameter(
        0.0, "radius around centre or axle of a circle that contains the robot [m]", 0.0, 100
    )
    footprint: str = parameter(
        "", "outline in Nav2's form, [[x, y], …]; reach is increased until it contains it"
    )
    response_file: str = parameter("", 'file of hcbf identify; "": margins of a slow robot')
    program: str = parameter("lex-cbf-qp", "the ranked program", choices=programs.names())
    period: float = parameter(
        0.05, "time without a velocity until the last is filtered again [s]", 0.005, 0.15
    )
    v_max: float = parameter(0.0, "strict limit of the speed [m/s]; 0: none", 0.0, 100.0, live=True)
    guidance: str = parameter(
        "", "method that leads to the goal around known regions", choices=("", "geodesic", "local")
    )
    use_bond: str = parameter(
        "auto", "bond with the lifecycle manager, given bondpy", choices=("auto", "no")
    )
    sources: tuple[SourceSettings, ...] = ()


OF_NODE = parameters_of(Settings)
OF_SOURCE = parameters_of(SourceSettings)
FOREIGN = ("use_sim_time", "qos_overrides", "start_type_description_service")
"""Parameters that ROS declares in every node, or the first part of their names."""
DESCRIBE_ROBOT = (
    "max_forward", "max_turn", "max_sideways", "look_ahead", "reach", "footprint", "response_file",
)  # fmt: skip
"""Parameters that describe a robot without a contract."""
TYPES_OF_PARAMETER = {
    **dict.fromkeys(("mount", "scan_period", "obstacle_speed", "range_noise"), ("scan",)),
    **dict.fromkeys(("base", "multiplier", "percent"), ("speed",)),
    **dict.fromkeys(("center", "radius"), ("circle",)),
    "points": ("polygon",),
    "file": GRIDS,
    "unknown": ("map",),
    "filter_info_topic": ("keepout", "speed"),
}
"""Parameter that only some sources have → their types; other parameters belong to all types."""
