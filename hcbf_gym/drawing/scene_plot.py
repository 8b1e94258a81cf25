"""A scene seen from above, drawn on matplotlib axes: regions, walls, boxes and the reference."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Ellipse, Patch, Polygon

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Oval, Shape, Shapes, Wall
from hcbf_gym.drawing import palette
from hcbf_gym.scenarios import BoxObstacle, Floor, Scenario

_WALL_EXTENT = 100.0  # [m] how far walls, which have no end, are drawn; longer than any scene
_GRID_SIDE = 100  # points along each side of the grid on which a function h(p) is evaluated
_PALENESS = 0.6  # the share of white in the area of a region


def draw_scene(axes: Axes, scenario: Scenario, t: float = 0.0) -> None:
    """Draw a scenario's regions at time t, its boxes, its reference, start and goal.

    Args:
        axes: where to draw; limits, labels and aspect are set.
        scenario: the scene.
        t: time [s], for regions that move.
    """
    if scenario.map is not None:
        draw_map(axes, scenario.map)
    draw_barriers(axes, scenario.barriers, t)
    for box in scenario.obstacles:
        _draw_box(axes, box)
    times = np.linspace(0.0, scenario.reference.duration, 200)
    reference = np.array([scenario.reference(time)[0] for time in times])
    axes.plot(*reference.T, "--", color=palette.REFERENCE, lw=1.2, zorder=6, label="reference")
    axes.plot(*scenario.start, "o", color="k", ms=4, ls="", zorder=7, label="start")
    axes.plot(*scenario.goal, "*", color="k", ms=10, ls="", zorder=7, label="goal")
    low, high = limits(scenario)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel="$p_x$ [m]", ylabel="$p_y$ [m]")


def _draw_box(axes: Axes, box: BoxObstacle) -> None:
    """Draw the base of a box obstacle, light boxes in another colour than fixed ones."""
    cos, sin = np.cos(box.yaw), np.sin(box.yaw)
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(box.size[:2]) / 2
    corners = half @ np.array([[cos, sin], [-sin, cos]]) + np.array(box.center)
    color = palette.LIGHT_BOX if box.mass is not None else palette.FIXED_BOX
    axes.add_patch(Polygon(corners, facecolor=color, edgecolor="k", lw=0.6, zorder=2))


def draw_barriers(
    axes: Axes, barriers: Iterable[Barrier | Shapes], t: float = 0.0, x: Array | None = None
) -> list[Artist]:
    """Draw the regions of barriers at time t, rank 1 on top, and return the artists.

    Args:
        axes: where to draw, its limits set.
        barriers: the barriers; of those that are no `Shape`, see x.
        t: time [s].
        x: (n,) a state whose first two entries are the position. With it, conditions on the
            position without an outline, such as a `Function`, are drawn where h < 0 while the
            other entries are those of x. Without it they are left out.
    """
    artists: list[Artist] = []
    for barrier in in_drawing_order(barriers):
        if isinstance(barrier, Shape):
            patch = region_patch(barrier, t)
            patch.set(**region_style(barrier.priority), zorder=1)
            artists.append(axes.add_patch(patch))
        elif x is not None and isinstance(barrier, Barrier) and barrier.reads_position:
            artists.extend(_draw_sublevel_set(axes, barrier, t, x))
    return artists


def in_drawing_order(barriers: Iterable[Any]) -> list[Any]:
    """Return barriers sorted for drawing: rank 1 last, because later ones cover earlier ones."""
    return sorted(barriers, key=lambda barrier: -barrier.priority)


def region_style(priority: int) -> dict[str, Any]:
    """Return the colours and the line width of regions of a priority, for a patch."""
    color = palette.priority_color(priority)
    return {"facecolor": palette.paler(color, _PALENESS), "edgecolor": color, "lw": 1.2}


def region_patch(shape: Shape, t: float = 0.0) -> Patch:
    """Return the region that a shape forbids at time t [s], as a patch on no axes."""
    shift, outline = shape.frame_velocity * t, shape.outline()
    if isinstance(outline, Wall):
        return Polygon(_wall_corners(outline))
    if isinstance(outline, Oval):
        width, height = 2 * np.array(outline.semi_axes)
        center = np.array(outline.center) + shift
        return Ellipse(tuple(center), width, height, angle=np.degrees(outline.angle))
    return Polygon(outline + shift)


def _wall_corners(wall: Wall) -> Array:
    """Return the corners (4, 2) of a rectangle [m] in the place of a wall's half plane."""
    normal = np.array(wall.normal)
    along = np.array([-normal[1], normal[0]])
    foot = wall.offset * normal
    first, second = foot - _WALL_EXTENT * along, foot + _WALL_EXTENT * along
    return np.array([first, second, second - _WALL_EXTENT * normal, first - _WALL_EXTENT * normal])


def _draw_sublevel_set(axes: Axes, barrier: Barrier, t: float, x: Array) -> list[Artist]:
    """Draw where a barrier's h < 0 in the window of the axes, and return the artists.

    h is evaluated at time t [s] in states that differ from x (n,) in the position alone.
    """
    xs, ys = window_coordinates(axes)
    states = np.tile(x, (_GRID_SIDE**2, 1))
    states[:, :2] = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    jets = barrier.batch(states, np.full(len(states), t))
    h = np.reshape(jets.h, (_GRID_SIDE, _GRID_SIDE))
    if not h.min() < 0.0:
        return []
    style = region_style(barrier.priority)
    levels = [float(h.min()), 0.0]
    return [
        axes.contourf(xs, ys, h, levels, colors=[style["facecolor"]], zorder=1),
        axes.contour(xs, ys, h, [0.0], colors=[style["edgecolor"]], linewidths=1.2, zorder=1),
    ]


def window_coordinates(axes: Axes) -> tuple[Array, Array]:
    """Return x (n,) and y (n,) of a grid over the window of the axes [m]."""
    return np.linspace(*axes.get_xlim(), _GRID_SIDE), np.linspace(*axes.get_ylim(), _GRID_SIDE)


def draw_map(axes: Axes, floor: Floor, covered: bool = False) -> None:
    """Draw a map by its ranks, rank 1 on top, and its speed zones dotted below all regions.

    Args:
        axes: where to draw.
        floor: the map.
        covered: whether to draw the pieces that cover the map's cells instead of the cells.
    """
    # zones first, and so below the regions; of both rank 1 last
    for region in sorted(floor.classes, key=lambda region: (region.limit is None, -region.rank)):
        style = region_style(region.rank)
        style["lw"] = 0.6 if covered else 0.0
        if region.limit is not None:
            style |= {"facecolor": "none", "hatch": "..."}
        outlines = floor.outlines(region, covered)
        axes.add_collection(PolyCollection(outlines, **style, zorder=0.9))


def limits(scenario: Scenario) -> tuple[Array, Array]:
    """Return the corners (2,), (2,) of a window on a scene's map, reference and regions [m]."""
    times = np.linspace(0.0, scenario.reference.duration, 50)
    points = [np.array(scenario.start), *(scenario.reference(t)[0] for t in times)]
    if scenario.map is not None:
        points.extend(scenario.map.grid.corners)
    return window(points, scenario.barriers)


def window(points: Iterable[Array], barriers: Iterable[Barrier | Shapes]) -> tuple[Array, Array]:
    """Return the corners (2,), (2,) of a window that shows points (2,) and bounded regions [m]."""
    points = list(points)
    for barrier in barriers:
        if isinstance(barrier, Shape) and not isinstance(barrier.outline(), Wall):
            points.extend(region_patch(barrier).get_extents().corners())
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    margin = 0.05 * np.max(high - low) + 0.3
    return low - margin, high + margin
