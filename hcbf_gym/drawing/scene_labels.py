"""The texts of a scene that is drawn from above: names in its regions, and legends."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from scipy.ndimage import distance_transform_edt

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier, Shape, Shapes
from hcbf_gym.drawing import scene_plot

TEXT_STYLE: dict[str, Any] = {  # arguments of `Axes.annotate` for a text within a scene
    "fontsize": 7,
    "ha": "center",
    "va": "center",
    "annotation_clip": True,
    "path_effects": [withStroke(linewidth=2.0, foreground="w", alpha=0.7)],
    "zorder": 9,
}

_MAX_NAMED_REGIONS = 8  # a scene of more regions has no names in the picture
_MAX_NAMES_PER_RANK = 4  # a legend does not name the regions of a rank that has more
_MAX_COLUMNS = 4  # of a legend
_CHARACTERS_PER_INCH = 15  # of a legend's font
_HANDLE_CHARACTERS = 6  # the width of a legend's patch or line, with its gaps


def name_regions(axes: Axes, barriers: Sequence[Barrier], path: Array) -> bool:
    """Write the names of a scene's shapes into their regions; return False for none or too many.

    A name is in the visible part of its region, far from edges and off the path. The name of a
    moving region has the time, 0, at which the region is there.

    Args:
        axes: shows the regions at time 0; its limits are set.
        barriers: the barriers at time 0.
        path: (k, 2) positions that names should not cover [m].
    """
    ordered = scene_plot.in_drawing_order(barriers)
    shapes = [barrier for barrier in ordered if isinstance(barrier, Shape)]
    if not 0 < len(shapes) <= _MAX_NAMED_REGIONS:
        return False
    xs, ys = scene_plot.window_coordinates(axes)
    spacing = np.array([xs[1] - xs[0], ys[1] - ys[0]])
    positions = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1)
    hidden = _near_path(path, positions, spacing)
    for shape in reversed(shapes):  # from the top down: each hides its part of those below
        inside = _inside(scene_plot.region_patch(shape), positions)
        visible = inside & ~hidden
        if visible.any():
            x, y = _place_of_name(visible, positions, spacing).tolist()
            text = f"{shape.name},\nt = 0" if shape.frame_velocity.any() else shape.name
            axes.annotate(text, (x, y), **TEXT_STYLE)
        hidden |= inside
    return True


def _near_path(path: Array, positions: Array, spacing: Array) -> Mask:
    """Return (n, n) which positions (n, n, 2) of a grid are the nearest to a point of a path."""
    count = len(positions)
    cells = np.rint((path - positions[0, 0]) / spacing).astype(int)
    cells = cells[((cells >= 0) & (cells < count)).all(axis=1)]  # others are beyond the window
    is_near = np.zeros((count, count), dtype=bool)
    is_near[cells[:, 0], cells[:, 1]] = True
    return is_near


def _inside(patch: Patch, positions: Array) -> Mask:
    """Return (n, n) which of the positions (n, n, 2) a patch that is on no axes covers."""
    path = patch.get_transform().transform_path(patch.get_path())
    return path.contains_points(positions.reshape(-1, 2)).reshape(positions.shape[:2])


def _place_of_name(visible: Mask, positions: Array, spacing: Array) -> Array:
    """Return the position (2,) of a name, far from the edges of its region's visible part [m].

    Of positions that are equally far from the edges, the nearest to the part's centre is best.
    """
    padded = np.pad(visible, 1)  # the edge of the window is an edge, too
    to_edge = np.asarray(distance_transform_edt(padded, sampling=spacing))[1:-1, 1:-1]
    to_center = np.linalg.norm(positions - positions[visible].mean(axis=0), axis=-1)
    best = np.unravel_index((to_edge - 0.05 * to_center).argmax(), visible.shape)
    return positions[best]


def rank_patches(barriers: Iterable[Barrier | Shapes], named_in_place: bool) -> list[Patch]:
    """Return a patch for each rank, labelled for a legend: "rank 1: trolley, wall".

    Args:
        barriers: the barriers whose ranks and names are listed.
        named_in_place: whether the picture has the names; then the label is the rank alone.
    """
    names_by_rank: dict[int, list[str]] = {}
    for barrier in barriers:
        names_by_rank.setdefault(barrier.priority, []).append(barrier.name)
    patches = []
    for rank, names in sorted(names_by_rank.items()):
        label = f"rank {rank}"
        if not named_in_place and len(names) <= _MAX_NAMES_PER_RANK:
            label += f": {', '.join(names)}"
        patches.append(Patch(**scene_plot.region_style(rank), label=label))
    return patches


def legend_below(figure: Figure, axes: Axes, others: Sequence[Artist] = ()) -> None:
    """Put the legend of `axes` under the panels of a figure, where it covers nothing.

    Args:
        figure: the figure of the axes.
        axes: the panel whose labelled artists the legend lists.
        others: further labelled artists, which the legend lists first.
    """
    handles = [*others, *axes.get_legend_handles_labels()[0]]
    room = _CHARACTERS_PER_INCH * figure.get_figwidth()
    columns = min(len(handles), _MAX_COLUMNS)
    while columns > 1 and _legend_width(handles, columns) > room:
        columns -= 1
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=8)


def _legend_width(handles: Sequence[Artist], columns: int) -> int:
    """Return the width of a legend with a number of columns, in characters."""
    widths = [len(str(handle.get_label())) + _HANDLE_CHARACTERS for handle in handles]
    rows = math.ceil(len(widths) / columns)
    return sum(max(widths[k : k + rows]) for k in range(0, len(widths), rows))
