"""The node's parameters, as ROS has them by their whole names: listed, read and checked.

`read` makes the settings in two passes: each value is read alone, by its type, range and choices,
and then the values are checked against one another: first each source by its type, then the node.
An invalid value is refused by the parameter's whole name before the node is active.
"""

import re
from collections.abc import Mapping, Sequence

from hcbf_gym.errors import InvalidInputError, check_options, shown
from hcbf_robots.ros.parameter import Parameter
from hcbf_robots.ros.settings import (
    DESCRIBE_ROBOT,
    FOREIGN,
    OF_NODE,
    OF_SOURCE,
    TYPES,
    TYPES_OF_PARAMETER,
    Settings,
    SourceSettings,
)

_TOPIC = re.compile(r"(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_PLACEHOLDER = re.compile(r"\{(node|ns|namespace)\}")
"""Parts of a topic's name that ROS replaces."""


def by_name(sources: Sequence[str]) -> dict[str, Parameter]:
    """Return whole name → parameter, for a node that has sources of these names."""
    known = {parameter.name: parameter for parameter in OF_NODE}
    for source in sources:
        known |= {f"{source}.{parameter.name}": parameter for parameter in OF_SOURCE}
    return known


def read(given: Mapping[str, object]) -> Settings:
    """Return the settings by the given parameters, and by the defaults of all others.

    Args:
        given: whole name → value, as a node or a file has them.

    Raises:
        InvalidInputError: if a name is unknown, or a value does not fit; the message names it.
    """
    given = {name: value for name, value in given.items() if name.split(".")[0] not in FOREIGN}
    names = _source_names(given.get("observation_sources", ()))
    known = by_name(names)
    check_options("parameters", given, known)
    values = {name: known[name].read(value, name) for name, value in given.items()}
    sources = []
    for source in names:
        of_source = {p.name: values.pop(f"{source}.{p.name}", p.default) for p in OF_SOURCE}
        sources.append(SourceSettings(source, **of_source))
        _check_source(sources[-1])
    settings = Settings(**values, sources=tuple(sources))
    _check_node(settings)
    return settings


def _source_names(listed: object) -> tuple[str, ...]:
    """Return the names in `observation_sources`; refuse a repeated name, or a parameter's."""
    known = by_name(())
    names: tuple[str, ...] = known["observation_sources"].read(listed, "observation_sources")
    are_valid = all(name.isidentifier() and name not in known for name in names)
    if not are_valid or len(set(names)) < len(names):
        raise InvalidInputError(
            f"parameter observation_sources: got {list(names)}, expected different names of "
            "letters, digits and _, none of them a parameter's"
        )
    return names


def _misfit(settings: Settings | SourceSettings, name: str, expected: str) -> InvalidInputError:
    """Return the error of a parameter that does not fit the others, by its whole name."""
    whole_name = f"{settings.name}.{name}" if isinstance(settings, SourceSettings) else name
    value = shown(getattr(settings, name))
    return InvalidInputError(f"parameter {whole_name}: got {value}, expected {expected}")


def _check_source(source: SourceSettings) -> None:
    """Refuse parameters of a source that do not fit its type, or one another."""
    if source.source_timeout < 0.0 and source.source_timeout != -1.0:
        raise _misfit(source, "source_timeout", "−1 or a number ≥ 0")
    for parameter in OF_SOURCE:
        name, default = parameter.name, parameter.default
        types = TYPES_OF_PARAMETER.get(name, TYPES)
        if source.type not in types and getattr(source, name) != default:
            expected = f"the default, {shown(default)}: {name} needs {source.name}.type "
            raise _misfit(source, name, expected + " or ".join(types))
    if source.type == "polygon":
        _check_polygon(source)
    elif source.type == "circle":
        _check_circle(source)
    else:
        _check_scan_or_grid(source)
    _check_topic_names(source, ("topic", "filter_info_topic"))


def _check_scan_or_grid(source: SourceSettings) -> None:
    """Refuse a scan or grid without a topic or file, or with more than one of them."""
    if len(source.mount) != 3:
        raise _misfit(source, "mount", "x, y, yaw")
    origins = [
        name
        for name in ("topic", "file", "filter_info_topic")
        if source.type in TYPES_OF_PARAMETER.get(name, TYPES)
    ]
    chosen = [f"{source.name}.{name}" for name in origins if getattr(source, name)]
    if len(chosen) != 1:
        got = " and ".join(chosen) or f"no {source.name}.topic"
        raise InvalidInputError(
            f"parameter {source.name}.topic: got {got}, expected one of {', '.join(origins)}"
        )
    if source.type == "speed" and source.when_inside == "stop":
        raise _misfit(source, "when_inside", "'leave': robots cross the cells of a speed mask")


def _check_polygon(source: SourceSettings) -> None:
    """Refuse a polygon without corners or a topic, or with corners that span no area."""
    if len(source.points) in (2, 4) or len(source.points) % 2 == 1:
        raise _misfit(source, "points", "x and y of each of three corners or more")
    if not (source.points or source.topic):
        raise _misfit(source, "points", f"corners, or messages of {source.name}.topic")


def _check_circle(source: SourceSettings) -> None:
    """Refuse a circle without a centre or a topic, or with a centre but no radius."""
    if len(source.center) not in (0, 2):
        raise _misfit(source, "center", "x and y")
    if not (source.center or source.topic):
        raise _misfit(source, "center", f"x and y, or messages of {source.name}.topic")
    if source.center and source.radius == 0.0:
        raise _misfit(source, "radius", "a number > 0")


def _check_topic_names(settings: Settings | SourceSettings, names: Sequence[str]) -> None:
    """Refuse parameters that are not valid names of topics; "" is accepted for no topic."""
    for name in names:
        topic = _PLACEHOLDER.sub("n", getattr(settings, name))
        if topic and _TOPIC.fullmatch(topic) is None:
            expected = "letters, digits and _, in parts that / separates and no digit begins"
            raise _misfit(settings, name, f"a topic: {expected}")


def _check_node(settings: Settings) -> None:
    """Refuse parameters of the node that do not fit one another."""
    _check_frames(settings)
    _check_robot(settings)
    if settings.cmd_vel_timeout < settings.period:
        raise _misfit(settings, "cmd_vel_timeout", f"at least the period, {settings.period:g}")
    topics = [parameter.name for parameter in OF_NODE if parameter.name.endswith("_topic")]
    _check_topic_names(settings, topics)
    for name in topics:
        if not getattr(settings, name) and name != "state_topic":
            raise _misfit(settings, name, "a topic")
    if settings.cmd_vel_in_topic == settings.cmd_vel_out_topic:
        raise _misfit(settings, "cmd_vel_out_topic", "another than cmd_vel_in_topic")


def _check_frames(settings: Settings) -> None:
    """Refuse a global frame in which the pose is unknown, and regions in another frame."""
    odometry, frame = settings.odom_frame_id, settings.global_frame_id
    if settings.pose_source == "odom" and frame != odometry:
        expected = f"odom_frame_id, {odometry!r}, or pose_source 'topic' or 'tf'"
        raise _misfit(settings, "global_frame_id", expected)
    for source in settings.sources:
        if source.type != "scan" and source.frame_id not in ("", frame):
            expected = f"global_frame_id, {frame!r}, for a {source.type}"
            raise _misfit(source, "frame_id", expected)


def _check_robot(settings: Settings) -> None:
    """Refuse a robot that is described twice, or not completely."""
    if settings.robot:
        for name in DESCRIBE_ROBOT:
            if getattr(settings, name):
                raise _misfit(settings, name, f"nothing beside robot {settings.robot!r}")
        return
    for name in ("max_forward", "max_turn"):
        if getattr(settings, name) == 0.0:
            raise _misfit(settings, name, "a number > 0, or a contract as robot")
    if (settings.max_sideways > 0.0) == (settings.look_ahead > 0.0):
        raise _misfit(
            settings,
            "look_ahead",
            "a number > 0 for a differential drive, or max_sideways > 0 for a robot that moves in "
            f"every direction, and not both (max_sideways is {settings.max_sideways:g})",
        )
