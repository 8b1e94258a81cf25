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
    BELONGS,
    DESCRIBED,
    FOREIGN,
    OF_NODE,
    OF_SOURCE,
    TYPES,
    Settings,
    SourceSettings,
)

_TOPIC = re.compile(r"(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_PLACEHOLDER = re.compile(r"\{(node|ns|namespace)\}")
"""Parts of a topic's name that ROS replaces."""


def by_name(sources: Sequence[str]) -> dict[str, Parameter]:
    """Return all parameters of a node with sources of these names: whole name → parameter."""
    of_node = {one.name: one for one in OF_NODE}
    return of_node | {f"{name}.{one.name}": one for name in sources for one in OF_SOURCE}


def read(given: Mapping[str, object]) -> Settings:
    """Return the settings that parameters make; others have their defaults.

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
    for name in names:
        own = {one.name: values.pop(f"{name}.{one.name}", one.default) for one in OF_SOURCE}
        sources.append(SourceSettings(name, **own))
        _check_source(sources[-1])
    settings = Settings(**values, sources=tuple(sources))
    _check_node(settings)
    return settings


def _source_names(listed: object) -> tuple[str, ...]:
    """Return the names in `observation_sources`, which are different and those of no parameter."""
    of_node = {one.name: one for one in OF_NODE}
    names: tuple[str, ...] = of_node["observation_sources"].read(listed, "observation_sources")
    are_valid = all(name.isidentifier() and name not in of_node for name in names)
    if not are_valid or len(set(names)) < len(names):
        raise InvalidInputError(
            f"parameter observation_sources: got {list(names)}, expected different names of "
            "letters, digits and _, none of them a parameter's"
        )
    return names


def _misfit(of: Settings | SourceSettings, name: str, expected: str) -> InvalidInputError:
    """Return the error of a parameter that does not fit the others; it has the whole name."""
    whole = f"{of.name}.{name}" if isinstance(of, SourceSettings) else name
    return InvalidInputError(
        f"parameter {whole}: got {shown(getattr(of, name))}, expected {expected}"
    )


def _check_source(source: SourceSettings) -> None:
    """Refuse parameters of a source that do not fit its type, or one another."""
    if source.source_timeout < 0.0 and source.source_timeout != -1.0:
        raise _misfit(source, "source_timeout", "−1 or a number ≥ 0")
    for own in OF_SOURCE:
        types = BELONGS.get(own.name, TYPES)
        if source.type not in types and getattr(source, own.name) != own.default:
            expected = f"the default, {shown(own.default)}: {own.name} needs {source.name}.type "
            raise _misfit(source, own.name, expected + " or ".join(types))
    if source.type == "polygon":
        _check_polygon(source)
    elif source.type == "circle":
        _check_circle(source)
    else:
        _check_scan_or_grid(source)
    _check_topic_names(source, ("topic", "filter_info_topic"))


def _check_scan_or_grid(source: SourceSettings) -> None:
    """Refuse a scan or grid that comes from nowhere, or from two places."""
    if len(source.mount) != 3:
        raise _misfit(source, "mount", "x, y, yaw")
    origins = [
        name
        for name in ("topic", "file", "filter_info_topic")
        if source.type in BELONGS.get(name, TYPES)
    ]
    given = [f"{source.name}.{name}" for name in origins if getattr(source, name)]
    if len(given) != 1:
        got = " and ".join(given) or f"no {source.name}.topic"
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


def _check_topic_names(of: Settings | SourceSettings, names: Sequence[str]) -> None:
    """Refuse parameters whose value is no valid name of a topic; "" is no topic."""
    for name in names:
        topic = _PLACEHOLDER.sub("n", getattr(of, name))
        if topic and _TOPIC.fullmatch(topic) is None:
            expected = "letters, digits and _, in parts that / separates and no digit begins"
            raise _misfit(of, name, f"a topic: {expected}")


def _check_node(settings: Settings) -> None:
    """Refuse parameters of a node that do not fit one another."""
    _check_frames(settings)
    _check_robot(settings)
    if settings.cmd_vel_timeout < settings.period:
        raise _misfit(settings, "cmd_vel_timeout", f"at least the period, {settings.period:g}")
    topics = [one.name for one in OF_NODE if one.name.endswith("_topic")]
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
    """Refuse a robot that two descriptions describe, or none that is complete."""
    if settings.robot:
        for name in DESCRIBED:
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
