"""Markers for RViz: the pieces near the robot by rank, the nominal command and the filtered one."""
# pyright: reportMissingImports=false
# messages come with ROS, or with the extra ros-wheels

from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.many import each
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.shape import Oval, Shape
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.decisions import Decision

NEAR = 4.0
"""Pieces nearer to the robot are drawn [m]."""
COLORS = ((0.8, 0.1, 0.1), (0.9, 0.5, 0.0), (0.1, 0.3, 0.8), (0.4, 0.2, 0.6))
"""Red, green and blue of ranks 1, 2, 3 and lower."""


def of(core: NodeCore, decision: Decision, stamp: Any) -> MarkerArray:
    """Return the markers of a core and its decision, with a stamp in ROS's form."""
    place = core.place
    ranks: dict[int, list[Array]] = {}
    for source in core.sources.values():
        for one in each(source.entries) if source.enabled else ():
            found = ranks.setdefault(int(one.priority), [])
            found += [c for c in _outlines(one) if np.hypot(*(c - place[:2]).T).min() < NEAR]
    made = [Marker(action=Marker.DELETEALL)]
    for rank, outlines in sorted(ranks.items()):
        lines = _marker(core, stamp, f"rank {rank}", Marker.LINE_LIST, COLORS[min(rank, 4) - 1])
        lines.scale.x = 0.02
        ends = [np.stack([one, np.roll(one, -1, axis=0)], 1).reshape(-1, 2) for one in outlines]
        lines.points = [_point(at) for at in np.concatenate(ends)] if ends else []
        made.append(lines)
    arrows = {"wanted": (decision.wanted, (0.5, 0.5, 0.5))}
    if decision.command is not None:
        arrows["given"] = decision.command, (0.0, 0.6, 0.2)
    for name, (command, color) in arrows.items():
        arrow = _marker(core, stamp, name, Marker.ARROW, color)
        arrow.scale.x, arrow.scale.y = 0.03, 0.06
        cos, sin = np.cos(place[2]), np.sin(place[2])
        ahead, aside = command[0], command[1] if len(command) == 3 else 0.0
        moved = np.array([cos * ahead - sin * aside, sin * ahead + cos * aside])
        arrow.points = [_point(place[:2]), _point(place[:2] + moved)]
        made.append(arrow)
    return MarkerArray(markers=made)


def _outlines(one: Any) -> list[Array]:
    """Return (k, 2) corners [m] around the inside of a barrier's pieces."""
    if isinstance(one, Mapped):
        return one.pieces.polygons
    if isinstance(one, Shape):
        outline = one.outline()
        if isinstance(outline, Oval):
            return [outline.corners(24)]
        return [outline] if isinstance(outline, np.ndarray) else []
    return []


def _marker(core: NodeCore, stamp: Any, name: str, kind: int, color: tuple[float, ...]) -> Marker:
    made = Marker(ns=name, type=kind, action=Marker.ADD)
    made.header.stamp, made.header.frame_id = stamp, core.settings.global_frame_id
    made.pose.orientation.w = 1.0
    made.color = ColorRGBA(r=color[0], g=color[1], b=color[2], a=0.9)
    return made


def _point(at: Array) -> Point:
    return Point(x=float(at[0]), y=float(at[1]))
