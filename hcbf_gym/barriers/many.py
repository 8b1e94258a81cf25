"""The elements of a scene besides single barriers: many shapes in an array, and several in one.

A scene is a sequence of elements. An element is a `Barrier`; `Shapes`, an array of what a scan or a
tracker returns; or an object of a class derived from `Several`, such as a map.
"""

import math
import operator
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from copy import copy
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, check_name
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, as_array, choose, finite_array, reals, shown
from hcbf_gym.models.constants import FARTHEST

_BUILT_IN = {*SHAPES, SpeedLimit}  # a user's own class may derive from one and change it


class Several(ABC):
    """An element that consists of several barriers, as a map does of its classes."""

    @property
    @abstractmethod
    def conditions(self) -> tuple[Barrier, ...]:
        """The barriers, in the order of their infos; the same objects until one changes.

        It is read at every step: other objects are other barriers.
        """


class Shapes:
    """k barriers of one shape and one rank, one element of a scene.

    They become rows without an object of each, so that a scan of 360 points costs some
    microseconds. For two-input filters of the planar double integrator. The arrays are copied.

    Args:
        name: what messages call them.
        priority: of all of them; 1 is the highest and strict.
        shape: the kind as JSON names it.
        values: of k shapes: their fields in order, but for the velocity, such as "disc" (k, 3):
            centre and radius [m], or "half-plane" (k, 3): unit normal into the allowed side, and
            n·p on the wall [m]; for "convex-polygon" (k, v, 2): v corners [m], counter-clockwise.
            With one more axis in front, (N, k, …), k of each of N plants that share the scene.
        velocity: (2,), (k, 2) or (N, k, 2) of their frames [m/s].
        moves_for: (), (k,) or (N, k) how long they go on moving, from when the object is first
            returned or set [s]. A gatekeeper lets the robot rest beyond the end of a path. Rows do
            not read it: give another object when they have stopped.

    Raises:
        UnknownNameError: if there is no such shape.
        InvalidInputError: if a number is not finite or out of range, or the array of another shape.

    Attributes:
        kind: their code, see `layout`.
        moves_for: (k,) or (N, k) [s].
        parameters: (k, WIDTH) or (N, k, WIDTH) what compiled code reads.

    Examples:
        >>> from hcbf_gym import barriers
        >>> scan = barriers.Shapes("scan", 1, "disc", [[1.0, 0.0, 0.1], [1.0, 0.2, 0.1]])
        >>> len(scan)
        2
    """

    reads_position = True

    def __init__(
        self,
        name: str,
        priority: int,
        shape: str,
        values: ArrayLike,
        velocity: ArrayLike = (0.0, 0.0),
        moves_for: ArrayLike = math.inf,
    ):
        check_name(name, priority)
        self.name = name
        self.priority = int(priority)
        cls = choose("shape", shape, {one.kind: one for one in SHAPES})
        self._class, self.kind = cls, cls.code
        given = as_array(f"{name}: values", values)
        axes = 3 if shape == "convex-polygon" else 2
        shape_of = given.shape[: -axes + 1]
        if given.ndim == axes + 1:
            flat = given.reshape(-1, *given.shape[2:])
        else:
            flat, shape_of = given, (len(given),) if given.ndim else ()
        blocks = cls.pack(f"{name}: {shape}", flat) if given.size else np.zeros((0, layout.WIDTH))
        self.parameters = blocks.reshape(*shape_of, layout.WIDTH)
        moving = as_array(f"{name}: velocity", velocity)
        expected = (*shape_of, 2)[-moving.ndim :] if moving.ndim else (2,)
        moving = finite_array(f"{name}: velocity", moving, expected, largest=FARTHEST)
        self.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]] = moving
        self.parameters.flags.writeable = False
        lasts = reals(f"{name}: moves_for", moves_for)
        fits = lasts.shape == (shape_of[-lasts.ndim :] if lasts.ndim else ())
        if not (fits and (lasts >= 0.0).all()):
            raise InvalidInputError(
                f"{name}: moves_for: got {shown(moves_for)}, expected one time >= 0 [s], or "
                f"{shape_of} of them"
            )
        self.moves_for = np.broadcast_to(lasts, shape_of)

    def of_plant(self, i: int, count: int) -> Array:
        """Return (k, WIDTH) the numbers of plant `i` of `count`.

        Raises:
            InvalidInputError: if they are of another number of plants.
        """
        if self.parameters.ndim == 2:
            return self.parameters
        if len(self.parameters) != count:
            raise InvalidInputError(
                f"{self.name}: got values of {len(self.parameters)} plants, expected {count}"
            )
        return self.parameters[i]

    def moved(self, step: Array) -> "Shapes":
        """Return the same shapes a step (2,) [m] away."""
        elsewhere = copy(self)
        blocks = self.parameters.reshape(-1, layout.WIDTH).copy()
        self._class.shift(blocks, step)
        elsewhere.parameters = blocks.reshape(self.parameters.shape)
        elsewhere.parameters.flags.writeable = False
        return elsewhere

    def __len__(self) -> int:
        """Return k."""
        return self.parameters.shape[-2]


Element = Barrier | Shapes | Several
Flat = tuple[Barrier | Shapes, ...]
"""The barriers of a scene, those of a `Several` one by one."""
Read = list[tuple[Several, tuple[Barrier, ...]]]
"""Elements of several barriers, and the barriers of which they consisted."""


def is_list(scene: object) -> TypeGuard[Sequence[Any]]:
    """Return whether something may be a sequence of elements, or of such sequences."""
    return isinstance(scene, Sequence) and not isinstance(scene, str | bytes)


def are_same(one: Sequence[Any], other: Sequence[Any]) -> bool:
    """Return whether two sequences hold the same objects; their values are never compared."""
    return one is other or (len(one) == len(other) and all(map(operator.is_, one, other)))


def flattened(scene: Iterable[Any]) -> tuple[Flat, Read]:
    """Return the barriers of a scene one by one, and what of it consists of several.

    Raises:
        InvalidInputError: if it is no sequence of elements.
    """
    if not is_list(scene):
        raise InvalidInputError(f"barriers: got {shown(scene)}, expected a sequence of Barriers")
    scene = tuple(scene)
    if all(type(one) in _BUILT_IN for one in scene):
        return scene, []
    read = [
        (one, tuple(one.conditions))
        for one in scene
        if type(one) not in _BUILT_IN and isinstance(one, Several)
    ]
    if read:
        parts = {id(one): conditions for one, conditions in read}
        scene = tuple(b for one in scene for b in parts.get(id(one), (one,)))
    for one in scene:
        if type(one) not in _BUILT_IN and not isinstance(one, Barrier | Shapes):
            raise InvalidInputError(
                f"barriers: got {shown(one)}, expected an object of a class derived from "
                "hcbf_gym.barriers.Barrier, Shapes, or a map"
            )
    return scene, read


def each(scene: Iterable[Any]) -> Flat:
    """Return the barriers of a scene one by one; see `flattened`."""
    return flattened(scene)[0]
