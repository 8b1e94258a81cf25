"""The elements of a scene: single barriers, arrays of shapes, and objects with several barriers.

A scene is a sequence of elements. An element is a `Barrier`; `Shapes`, an array of what a scan or a
tracker returns; or an object of a class derived from `Several`, such as a map.
"""

import math
import operator
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from copy import copy
from functools import lru_cache
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, check_name, is_newer, reads_planar_jet
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.mapped import Mapped, MappedRegion, MappedZone, OnGrid, SeenRegion
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import (
    InvalidInputError,
    as_array,
    choose,
    finite_array,
    overridden,
    reals,
    shown,
)
from hcbf_gym.models.constants import FARTHEST

_BUILT_IN = {*SHAPES, SpeedLimit}  # exact types: a user's class may derive from one and change it
_MAPPED = Mapped, OnGrid, MappedRegion, MappedZone, SeenRegion


class Several(ABC):
    """An element that consists of several barriers, as a map does of its classes."""

    @property
    @abstractmethod
    def conditions(self) -> tuple[Barrier, ...]:
        """The barriers, in the order of their infos; the same objects until one changes.

        It is read at every step. A changed barrier must be another object.
        """


class Shapes:
    """k barriers of one shape and one rank, which are one element of a scene.

    They become rows without an object for each, so that a scan of 360 points costs some
    microseconds. Filters of the planar double integrator take them. The arrays are copied.

    Args:
        name: what messages call the shapes.
        priority: the rank of all shapes; 1 is the highest and strict.
        shape: the kind of shape by its name in JSON.
        values: the fields of k shapes in order, but for the velocity, such as "disc" (k, 3):
            centre and radius [m], or "half-plane" (k, 3): unit normal into the allowed side, and
            n·p on the wall [m]; for "convex-polygon" (k, v, 2): v corners [m], counter-clockwise.
            With one more axis in front, (N, k, …), each of N plants has k shapes.
        velocity: (2,), (k, 2) or (N, k, 2) the velocity of the shapes [m/s].
        moves_for: (), (k,) or (N, k) how long they go on moving, from when the object is first
            returned or set [s]. A gatekeeper lets the robot rest beyond the end of a path. Rows do
            not read it: give another object when they have stopped.

    Raises:
        UnknownNameError: if there is no such shape.
        InvalidInputError: if a number is not finite or out of range, or the array of another shape.

    Attributes:
        kind: the code of the shape, see `layout`.
        moves_for: (k,) or (N, k) [s].
        parameters: (k, WIDTH) or (N, k, WIDTH) the blocks of the shapes, see `layout`.

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
        self._class = choose("shape", shape, {cls.kind: cls for cls in SHAPES})
        self.kind = self._class.code
        self.parameters = self._blocks(shape, as_array(f"{name}: values", values))
        leading = self.parameters.shape[:-1]  # (k,) or (N, k)
        given_velocity = as_array(f"{name}: velocity", velocity)
        fitting = (*leading, 2)[-given_velocity.ndim :] if given_velocity.ndim else (2,)
        self.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]] = finite_array(
            f"{name}: velocity", given_velocity, fitting, largest=FARTHEST
        )
        self.parameters.flags.writeable = False
        seconds = reals(f"{name}: moves_for", moves_for)
        fits = seconds.shape == (leading[-seconds.ndim :] if seconds.ndim else ())
        if not (fits and (seconds >= 0.0).all()):
            raise InvalidInputError(
                f"{name}: moves_for: got {shown(moves_for)}, expected one time >= 0 [s], or "
                f"{leading} of them"
            )
        self.moves_for = np.broadcast_to(seconds, leading)

    def _blocks(self, shape: str, values: Array) -> Array:
        """Return (k, WIDTH) or (N, k, WIDTH) the blocks of shapes at rest."""
        axes = 3 if shape == "convex-polygon" else 2  # of the values of one plant
        leading = values.shape[:1]
        if values.ndim == axes + 1:
            leading, values = values.shape[:2], values.reshape(-1, *values.shape[2:])
        blocks = np.zeros((0, layout.WIDTH))
        if values.size:
            blocks = self._class.pack(f"{self.name}: {shape}", values)
        return blocks.reshape(*leading, layout.WIDTH)

    def of_plant(self, i: int, count: int) -> Array:
        """Return (k, WIDTH) the blocks of plant `i` of `count`.

        Raises:
            InvalidInputError: if the object has those of another number of plants.
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
        moved = copy(self)
        blocks = self.parameters.reshape(-1, layout.WIDTH).copy()
        self._class.shift(blocks, step)
        moved.parameters = blocks.reshape(self.parameters.shape)
        moved.parameters.flags.writeable = False
        return moved

    def __len__(self) -> int:
        """Return k."""
        return self.parameters.shape[-2]


Element = Barrier | Shapes | Several
Flat = tuple[Barrier | Shapes, ...]
"""The barriers of a scene one by one, those of a `Several` in its place."""
Read = list[tuple[Several, tuple[Barrier, ...]]]
"""Each `Several` of a scene with its barriers when the scene was read."""


def is_list(scene: object) -> TypeGuard[Sequence[Any]]:
    """Return whether an object is a sequence other than text, as scenes and lists of scenes are."""
    return isinstance(scene, Sequence) and not isinstance(scene, str | bytes)


def are_same(one: Sequence[Any], other: Sequence[Any]) -> bool:
    """Return whether two sequences hold the same objects; their values are never compared."""
    return one is other or (len(one) == len(other) and all(map(operator.is_, one, other)))


def flattened(scene: Iterable[Any]) -> tuple[Flat, Read]:
    """Return the barriers of a scene one by one, and each `Several` with its barriers.

    Raises:
        InvalidInputError: if it is no sequence of elements, or rows would not read what a class of
            a user's overrides.
    """
    if not is_list(scene):
        raise InvalidInputError(f"barriers: got {shown(scene)}, expected a sequence of Barriers")
    elements = tuple(scene)
    if all(type(element) in _BUILT_IN for element in elements):
        return elements, []
    barriers: list[Barrier | Shapes] = []
    read: Read = []
    for element in elements:
        if type(element) not in _BUILT_IN and isinstance(element, Several):
            conditions = tuple(element.conditions)
            read.append((element, conditions))
            barriers += conditions
        else:
            barriers.append(element)
    for barrier in barriers:
        if type(barrier) not in _BUILT_IN and not isinstance(barrier, Barrier | Shapes):
            raise InvalidInputError(
                f"barriers: got {shown(barrier)}, expected an object of a class derived from "
                "hcbf_gym.barriers.Barrier, Shapes, or a map"
            )
        if isinstance(barrier, Barrier) and (misread := _misread(type(barrier))):
            raise InvalidInputError(f"{barrier.name}: got a {type(barrier).__name__} {misread}")
    return tuple(barriers), read


@lru_cache(maxsize=1024)
def _misread(cls: type[Barrier]) -> str:
    """Return in words what rows would not read of a class of barriers; empty if they read all."""
    for kinds, source in ((Function,), "function"), (_MAPPED, "pieces"):
        changed = overridden(cls, *kinds) if issubclass(cls, kinds) else []
        of_its_own = [name for name in changed if vars(Barrier).get(name) is not getattr(cls, name)]
        if unread := [name for name in of_its_own if name != "reads_position"]:
            return f"with its own {', '.join(unread)}, which rows do not read; change its {source}"
    read = "planar_jet" if reads_planar_jet(cls) else "jet"
    if is_newer(cls, "h", than=read):
        return f"with its own h, which rows do not read; override its {read}"
    return ""


def each(scene: Iterable[Any]) -> Flat:
    """Return the barriers of a scene one by one; see `flattened`."""
    return flattened(scene)[0]
