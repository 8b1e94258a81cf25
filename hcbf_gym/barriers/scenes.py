"""The scenes of N plants as users hand them over: one list for all, a list each, or arrays."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.many import Several, Shapes
from hcbf_gym.barriers.set import BarrierSet, is_list
from hcbf_gym.barriers.shapes import SHAPES, ConvexPolygon
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, as_array, choose, finite_array, shown
from hcbf_gym.models.constants import FARTHEST

SPEED_LIMIT = "speed-limit"


def scenes_of(barriers: object, count: int, before: BarrierSet | None = None) -> BarrierSet:
    """Return the scenes of N plants.

    Args:
        barriers: a sequence of barriers, which all plants share; N such sequences of any lengths;
            or a `BarrierSet` of N scenes.
        count: N.
        before: as `BarrierSet` takes it.

    Raises:
        InvalidInputError: if it is none of them.
    """
    if isinstance(barriers, BarrierSet):
        if len(barriers.kind) != count:
            raise InvalidInputError(
                f"barriers: got a set of {len(barriers.kind)} scenes, expected {count}"
            )
        return barriers
    if not is_list(barriers):
        raise InvalidInputError(f"barriers: got {shown(barriers)}, expected a sequence of Barriers")
    if any(isinstance(entry, Barrier | Shapes | Several) for entry in barriers) or not barriers:
        one = BarrierSet([tuple(barriers)], before if count == 1 else None)
        one.is_kept = True
        return one if count == 1 else one.repeated(count)
    if len(barriers) != count or not all(is_list(scene) for scene in barriers):
        raise InvalidInputError(
            f"barriers: got {len(barriers)} entries that are no barriers, expected one list of "
            f"barriers for all plants, or {count} lists, one for each"
        )
    scenes = BarrierSet([tuple(scene) for scene in barriers], before, fills=True)
    scenes.is_kept = True
    return scenes


def scenes_of_arrays(
    kinds: ArrayLike, numbers: ArrayLike, ranks: ArrayLike, velocities: ArrayLike, count: int
) -> BarrierSet:
    """Return the scenes of N plants from arrays, without an object for a barrier.

    Args:
        kinds: (m,) or (N, m) names of shapes as JSON has them, such as "disc", or "speed-limit".
        numbers: (m, w) or (N, m, w); each kind reads as many from the left as it has fields, in
            the order of `Shapes`; a polygon reads all of them as corners; a speed limit reads v_max
            [m/s].
        ranks: (m,) or (N, m), 1 is the highest and strict.
        velocities: (2,), (m, 2) or (N, m, 2) of the shapes' frames [m/s].
        count: N.

    Raises:
        UnknownNameError: if there is no such kind; the message lists the choices.
        InvalidInputError: if a number is not finite or out of range, or an array of another shape.
    """
    named, given = as_array("kinds", kinds), as_array("numbers", numbers)
    if named.dtype.kind != "U":
        raise InvalidInputError(f"kinds: got {named.dtype}, expected names, such as ['disc']")
    m, width = _last(named, 1, "kinds")[0], _last(given, 2, "numbers")[1]
    codes = np.broadcast_to(named, _shape(named, (count, m), "kinds"))
    values = np.broadcast_to(given, _shape(given, (count, m, width), "numbers"))
    levels = as_array("ranks", ranks)
    levels = np.broadcast_to(levels, _shape(levels, (count, m), "ranks"))
    if levels.dtype.kind not in "iu" or not ((levels >= 1) & (levels <= layout.LOWEST_RANK)).all():
        raise InvalidInputError(
            f"ranks: got {shown(levels)}, expected whole numbers from 1 to {layout.LOWEST_RANK}"
        )
    moving = as_array("velocities", velocities)
    moving = finite_array("velocities", moving, moving.shape, largest=FARTHEST)
    moving = np.broadcast_to(moving, _shape(moving, (count, m, 2), "velocities"))

    scenes = BarrierSet([()] * count)
    scenes.kind = np.zeros((count, m), dtype=np.int64)
    scenes.parameters = np.zeros((count, m, layout.WIDTH))
    choices: dict[str, Any] = {one.kind: one for one in SHAPES} | {SPEED_LIMIT: SpeedLimit}
    for name in np.unique(codes).tolist():
        chosen, cls = codes == name, choose("kind", name, choices)
        scenes.kind[chosen] = layout.SPEED_LIMIT if cls is SpeedLimit else cls.code
        scenes.parameters[chosen] = _blocks(cls, values[chosen])
        if cls is not SpeedLimit:
            scenes.parameters[chosen, : layout.VELOCITY_Y + 1] = moving[chosen]
    scenes.priority = levels.astype(np.int64, order="C")
    scenes.keeps_margin = ((scenes.kind != layout.SPEED_LIMIT) & (levels == 1)).astype(np.float64)
    scenes.own_margin = np.zeros((count, m))
    scenes.is_kept = True
    return scenes


def _blocks(cls: Any, values: Array) -> Array:
    """Return (k, WIDTH) the blocks of k barriers of one class.

    Raises:
        InvalidInputError: if a number is not finite or out of range.
    """
    if cls is SpeedLimit:
        limits = finite_array("numbers of speed limits", values[:, 0], (None,), largest=FARTHEST)
        if (limits <= 0.0).any():
            raise InvalidInputError(f"v_max: got {limits.min():g} m/s, expected > 0")
        blocks = np.zeros((len(limits), layout.WIDTH))
        blocks[:, layout.V_MAX] = limits
        return blocks
    if cls is ConvexPolygon:
        if values.shape[1] % 2:
            raise InvalidInputError(
                f"numbers of the kind {cls.kind!r}: got {values.shape[1]} in a row, expected x and "
                "y of each corner, an even number"
            )
        own = values.reshape(len(values), -1, 2)
    else:
        own = values[:, : sum(cls.widths().values())]
    return cls.pack(f"numbers of the kind {cls.kind!r}", own)


def _last(array: Any, count: int, name: str) -> tuple[int, ...]:
    """Return the last so many entries of an array's shape.

    Raises:
        InvalidInputError: if it has fewer.
    """
    if array.ndim < count:
        raise InvalidInputError(f"{name}: got shape {array.shape}, expected {count} axes or more")
    return array.shape[-count:]


def _shape(array: Any, expected: tuple[int, ...], name: str) -> tuple[int, ...]:
    """Return the expected shape, which an array of all plants or of each fits.

    Raises:
        InvalidInputError: if it does not fit.
    """
    least = array.ndim
    if array.shape != expected[len(expected) - least :]:
        raise InvalidInputError(
            f"{name}: got shape {array.shape}, expected {expected} or {expected[1:]} for all plants"
        )
    return expected
