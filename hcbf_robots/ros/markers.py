"""Markers for RViz: regions near the robot by rank, the nominal velocity and the filtered one."""
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
from hcbf_robots.online.sample import placed
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.decisions import Decision

Color = tuple[float, float, float]  # red, green and blue, each from 0 to 1
RANK_COLORS = {1: (0.8, 0.1, 0.1), 2: (0.9, 0.5, 0.0), 3: (0.1, 0.3, 0.8)}
LOWER_RANK_COLOR, NOMINAL_COLOR, FILTERED_COLOR = (0.4, 0.2, 0.6), (0.5, 0.5, 0.5), (0.0, 0.6, 0.2)
OPACITY = 0.9
DRAWN_WITHIN = 4.0
"""Outlines that come nearer to the robot than this are drawn [m]."""
OVAL_CORNERS = 24  # of the polygon that is drawn for an oval
LINE_WIDTH, SHAFT_WIDTH, HEAD_WIDTH = 0.02, 0.03, 0.06
"""Widths of outlines, and of the shaft and the head of an arrow [m]."""


def marker_array(core: NodeCore, decision: Decision, stamp: Any) -> MarkerArray:
    """Return the markers of a decision at a `builtin_interfaces/Time`, which replace all others."""
    markers = [Marker(action=Marker.DELETEALL)]
    for rank, outlines in sorted(_nearby_outlines(core).items()):
        color = RANK_COLORS.get(rank, LOWER_RANK_COLOR)
        lines = _marker(core, stamp, f"rank {rank}", Marker.LINE_LIST, color)
        lines.scale.x = LINE_WIDTH
        lines.points = [_point(end) for outline in outlines for end in _edge_ends(outline)]
        markers.append(lines)
    markers.append(_arrow(core, stamp, "wanted", decision.nominal, NOMINAL_COLOR))
    if decision.command is not None:
        markers.append(_arrow(core, stamp, "given", decision.command, FILTERED_COLOR))
    return MarkerArray(markers=markers)


def _nearby_outlines(core: NodeCore) -> dict[int, list[Array]]:
    """Return rank → (k, 2) outlines near the robot [m], of each rank that an enabled source has."""
    position = core.pose[:2]
    by_rank: dict[int, list[Array]] = {}
    for source in core.sources.values():
        for barrier in each(source.entries) if source.enabled else ():
            nearby = by_rank.setdefault(int(barrier.priority), [])
            for outline in _outlines(barrier):
                distances = np.hypot(*(outline - position).T)
                if distances.min() < DRAWN_WITHIN:
                    nearby.append(outline)
    return by_rank


def _outlines(barrier: Any) -> list[Array]:
    """Return the outlines of a barrier's pieces by their (k, 2) corners [m]; some have none."""
    if isinstance(barrier, Mapped):
        return barrier.pieces.polygons
    outline = barrier.outline() if isinstance(barrier, Shape) else None
    if isinstance(outline, Oval):
        return [outline.corners(OVAL_CORNERS)]
    return [outline] if isinstance(outline, np.ndarray) else []


def _edge_ends(outline: Array) -> Array:
    """Return (2k, 2) both ends of each edge of a closed outline, as a list of lines has them."""
    return np.stack([outline, np.roll(outline, -1, axis=0)], axis=1).reshape(-1, 2)


def _arrow(core: NodeCore, stamp: Any, name: str, velocity: Array, color: Color) -> Marker:
    """Return an arrow along a velocity (v, ω) or (v_x, v_y, ω), one metre long at 1 m/s."""
    arrow = _marker(core, stamp, name, Marker.ARROW, color)
    arrow.scale.x, arrow.scale.y = SHAFT_WIDTH, HEAD_WIDTH
    sideways = velocity[1] if len(velocity) == 3 else 0.0
    tip = placed(core.pose, np.array([velocity[0], sideways, 0.0]))
    arrow.points = [_point(core.pose), _point(tip)]
    return arrow


def _marker(core: NodeCore, stamp: Any, name: str, marker_type: int, color: Color) -> Marker:
    """Return a marker in the global frame, still without points and widths."""
    marker = Marker(ns=name, type=marker_type, action=Marker.ADD)
    marker.header.stamp, marker.header.frame_id = stamp, core.settings.global_frame_id
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=color[0], g=color[1], b=color[2], a=OPACITY)
    return marker


def _point(position: Array) -> Point:
    return Point(x=float(position[0]), y=float(position[1]))
