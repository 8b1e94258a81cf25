"""A scene seen from above, drawn on matplotlib axes: regions, walls, boxes and the reference."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from scipy.ndimage import distance_transform_edt

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier, Oval, Shape, Shapes, Wall
from hcbf_gym.drawing import palette
from hcbf_gym.scenarios import Floor, Scenario

_FAR = 100.0
_NAMED = 4  # regions of a rank that a legend names
_CHARACTERS = 15  # of a legend in an inch
_IN_PLACE = 8  # regions of a scene that are named where they are
NAMED_AT: dict[str, Any] = {
    "fontsize": 7,
    "ha": "center",
    "va": "center",
    "annotation_clip": True,
    "path_effects": [withStroke(linewidth=2.0, foreground="w", alpha=0.7)],
    "zorder": 9,
}
"""Style of a text within a scene."""
_CELLS = 100  # along a side of the grid on which a condition without an outline is drawn


def outline(barrier: object, t: float = 0.0) -> Patch | None:
    """Return what a built-in region forbids at time t as a patch; None for other barriers."""
    if not isinstance(barrier, Shape):
        return None
    shift, drawn = barrier.frame_velocity * t, barrier.outline()
    if isinstance(drawn, Wall):
        normal = np.array(drawn.normal)
        along = np.array([-normal[1], normal[0]])
        foot = drawn.offset * normal
        corners = [foot - _FAR * along, foot + _FAR * along]
        return Polygon([*corners, corners[1] - _FAR * normal, corners[0] - _FAR * normal])
    if isinstance(drawn, Oval):
        width, height = 2 * np.array(drawn.semi_axes)
        center = np.array(drawn.center) + shift
        return EllipsePatch(tuple(center), width, height, angle=np.degrees(drawn.angle))
    return Polygon(drawn + shift)


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
        cos, sin = np.cos(box.yaw), np.sin(box.yaw)
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(box.size[:2]) / 2
        corners = half @ np.array([[cos, sin], [-sin, cos]]) + np.array(box.center)
        color = palette.LIGHT_BOX if box.mass is not None else palette.FIXED_BOX
        axes.add_patch(Polygon(corners, facecolor=color, edgecolor="k", lw=0.6, zorder=2))
    times = np.linspace(0.0, scenario.reference.duration, 200)
    reference = np.array([scenario.reference(s)[0] for s in times])
    axes.plot(*reference.T, "--", color=palette.REFERENCE, lw=1.2, zorder=6, label="reference")
    axes.plot(*scenario.start, "o", color="k", ms=4, ls="", zorder=7, label="start")
    axes.plot(*scenario.goal, "*", color="k", ms=10, ls="", zorder=7, label="goal")
    low, high = limits(scenario)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel="$p_x$ [m]", ylabel="$p_y$ [m]")


def draw_barriers(
    axes: Axes, barriers: Iterable[Barrier | Shapes], t: float = 0.0, x: Array | None = None
) -> list[Artist]:
    """Draw the regions among barriers at time t, the first rank on top, and return what is drawn.

    Args:
        axes: where to draw, its limits set.
        barriers: of which those with an outline are drawn.
        t: time [s].
        x: (n,) a state whose first two entries are the position: conditions on it that have no
            outline, such as a `Function`, are drawn, too, at its other entries.
    """
    drawn: list[Artist] = []
    for barrier in _as_drawn(barriers):
        patch = outline(barrier, t)
        color = palette.priority_color(barrier.priority)
        if patch is not None:
            patch.set(facecolor=palette.paler(color, 0.6), edgecolor=color, lw=1.2, zorder=1)
            drawn.append(axes.add_patch(patch))
        elif x is not None and isinstance(barrier, Barrier) and barrier.reads_position:
            drawn.extend(_draw_level(axes, barrier, t, x, color))
    return drawn


def _as_drawn(barriers: Iterable[Any]) -> list[Any]:
    """Return barriers in the order in which they are drawn: the first rank last, and so on top."""
    return sorted(barriers, key=lambda barrier: -barrier.priority)


def _draw_level(axes: Axes, barrier: Barrier, t: float, x: Array, color: str) -> list[Artist]:
    """Draw where h < 0 over the positions in the window of the axes."""
    side = [np.linspace(*limits, _CELLS) for limits in (axes.get_xlim(), axes.get_ylim())]
    states = np.tile(x, (_CELLS**2, 1))
    states[:, :2] = np.stack(np.meshgrid(*side), axis=-1).reshape(-1, 2)
    jets = barrier.batch(states, np.full(len(states), t))
    h = np.reshape(jets.h, (_CELLS, _CELLS))
    if not h.min() < 0.0:
        return []
    levels, filled = [float(h.min()), 0.0], palette.paler(color, 0.6)
    return [
        axes.contourf(*side, h, levels, colors=[filled], zorder=1),
        axes.contour(*side, h, [0.0], colors=[color], linewidths=1.2, zorder=1),
    ]


def draw_map(axes: Axes, ranked: Floor, covered: bool = False) -> None:
    """Draw the cells of a map by their ranks, the highest on top, and zones hatched.

    Args:
        axes: where to draw.
        ranked: the map.
        covered: whether to draw the pieces that cover the cells instead of these.
    """
    for one in sorted(ranked.classes, key=lambda c: (c.limit is None, -c.rank)):
        color = palette.priority_color(one.rank)
        style: dict[str, Any] = {
            "facecolor": palette.paler(color, 0.6),
            "lw": 0.0,
            "zorder": 0.9,
        }
        if one.limit is not None:
            style |= {"facecolor": "none", "edgecolor": color, "hatch": "..."}
        edge = {"edgecolor": color, "lw": 0.6} if covered else {}
        axes.add_collection(PolyCollection(ranked.outlines(one, covered), **(style | edge)))


def rank_patches(barriers: Iterable[Barrier | Shapes], named_in_place: bool) -> list[Patch]:
    """Return a patch for each rank, labelled for a legend: "rank 1: trolley, wall".

    Args:
        barriers: of these ranks.
        named_in_place: whether the picture has their names; then the label is the rank alone.
    """
    named: dict[int, list[str]] = {}
    for barrier in barriers:
        named.setdefault(barrier.priority, []).append(barrier.name)
    patches = []
    for rank, names in sorted(named.items()):
        color = palette.priority_color(rank)
        listed = not named_in_place and len(names) <= _NAMED
        label = f"rank {rank}" + (f": {', '.join(names)}" if listed else "")
        face = palette.paler(color, 0.6)
        patches.append(Patch(facecolor=face, edgecolor=color, lw=1.2, label=label))
    return patches


def name_regions(axes: Axes, barriers: Sequence[Barrier], taken: Array) -> bool:
    """Write their names into the regions of a scene that has few; return whether it has.

    A name is where its region is seen, as far as may be from its edges and from `taken`; a moving
    region's has the time at which it is drawn.

    Args:
        axes: whose limits are set.
        barriers: as they are at the start.
        taken: (k, 2) places that names should not cover [m].
    """
    shapes = [barrier for barrier in _as_drawn(barriers) if isinstance(barrier, Shape)]
    if not 0 < len(shapes) <= _IN_PLACE:
        return False
    side = [np.linspace(*ends, _CELLS) for ends in (axes.get_xlim(), axes.get_ylim())]
    places = np.stack(np.meshgrid(*side, indexing="ij"), axis=-1)
    step = np.array([side[0][1] - side[0][0], side[1][1] - side[1][0]])
    covers = [_covers(outline(shape), places) for shape in shapes]
    free = np.ones((_CELLS, _CELLS), dtype=bool)
    cells = np.rint((taken - places[0, 0]) / step).astype(int)
    free[tuple(cells[((cells >= 0) & (cells < _CELLS)).all(axis=1)].T)] = False
    for k, shape in enumerate(shapes):
        seen = np.logical_and(covers[k], free)
        for above in covers[k + 1 :]:
            seen &= ~above
        if not seen.any():
            continue
        room = np.asarray(distance_transform_edt(np.pad(seen, 1), sampling=step))[1:-1, 1:-1]
        far = np.linalg.norm(places - places[seen].mean(axis=0), axis=-1)
        x, y = places[np.unravel_index((room - 0.05 * far).argmax(), room.shape)].tolist()
        moves = shape.frame_velocity.any()
        axes.annotate(f"{shape.name},\nt = 0" if moves else shape.name, (x, y), **NAMED_AT)
    return True


def _covers(patch: Patch | None, places: Array) -> Mask:
    """Return (n, n) whether a patch that is on no axes covers each of the places (n, n, 2)."""
    if patch is None:
        return np.zeros(places.shape[:2], dtype=bool)
    path = patch.get_transform().transform_path(patch.get_path())
    return path.contains_points(places.reshape(-1, 2)).reshape(places.shape[:2])


def legend_below(figure: Figure, axes: Axes, others: Sequence[Artist] = ()) -> None:
    """Put the legend of `axes` under the panels of a figure, where it covers nothing.

    Args:
        figure: with the axes.
        axes: whose labels count.
        others: labelled, before those.
    """
    handles = [*others, *axes.get_legend_handles_labels()[0]]
    columns = min(len(handles), 4)
    while columns > 1 and _legend_width(handles, columns) > _CHARACTERS * figure.get_figwidth():
        columns -= 1
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=8)


def _legend_width(handles: Sequence[Artist], columns: int) -> int:
    """Return how wide a legend of so many columns is, in characters, its handles included."""
    widths = [len(str(handle.get_label())) + 6 for handle in handles]
    rows = -(-len(widths) // columns)
    return sum(max(widths[k : k + rows]) for k in range(0, len(widths), rows))


def limits(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (2,), (2,) of a window that shows start, goal and the bounded regions."""
    times = np.linspace(0.0, scenario.reference.duration, 50)
    points = [np.array(scenario.start), *(scenario.reference(t)[0] for t in times)]
    if scenario.map is not None:
        points.extend(scenario.map.grid.corners)
    return window(points, scenario.barriers)


def window(
    points: Iterable[Array], barriers: Iterable[Barrier | Shapes]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (2,), (2,) of a window that shows points (2,) and bounded regions [m]."""
    points = list(points)
    for barrier in barriers:
        patch = outline(barrier)
        if patch is not None and not _is_wall(barrier):
            points.extend(patch.get_extents().corners())
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    pad = 0.05 * np.max(high - low) + 0.3
    return low - pad, high + pad


def _is_wall(barrier: object) -> bool:
    return isinstance(barrier, Shape) and isinstance(barrier.outline(), Wall)
