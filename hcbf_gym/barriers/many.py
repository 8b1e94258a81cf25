"""Many barriers of one shape and one rank, given as an array: what a scan or a tracker returns."""

from abc import ABC, abstractmethod
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, check_name
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.errors import as_array, choose, finite_array
from hcbf_gym.models.constants import FARTHEST


class Several(ABC):
    """What stands in a list of barriers for several of them, such as a map for its classes."""

    @property
    @abstractmethod
    def conditions(self) -> tuple[Barrier, ...]:
        """The barriers, in the order of their infos; the same objects until one changes.

        It is read at every step: other objects are other barriers.
        """


class Shapes:
    """k barriers of one shape, which stand in a list of barriers as one entry.

    They become rows without an object of their own, so that a scan of 360 points costs some
    microseconds. For two-input filters of the planar double integrator.

    Args:
        name: what messages call them.
        priority: of all of them; 1 is the highest and strict.
        shape: the kind as JSON names it.
        values: of k shapes, copied: their fields in order, but for the velocity, such as "disc"
            (k, 3): centre and radius [m], or "half-plane" (k, 3): unit normal into the allowed
            side, and n·p on the wall [m]; for "convex-polygon" (k, v, 2): v corners [m],
            counter-clockwise.
        velocity: (2,) or (k, 2) of their frames [m/s].

    Raises:
        UnknownNameError: if there is no such shape.
        InvalidInputError: if a number is not finite or out of range, or the array of another shape.

    Attributes:
        kind: which kernel evaluates them, see `layout`.
        parameters: (k, WIDTH) what it reads.

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
    ):
        check_name(name, priority)
        self.name = name
        self.priority = int(priority)
        cls = choose("shape", shape, {one.kind: one for one in SHAPES})
        self._class, self.kind = cls, cls.code
        given = as_array(f"{name}: values", values)
        nothing = np.zeros((0, layout.WIDTH))
        self.parameters = cls.pack(f"{name}: {shape}", given) if given.size else nothing
        expected = (2,) if as_array(f"{name}: velocity", velocity).ndim == 1 else (len(self), 2)
        moving = finite_array(f"{name}: velocity", velocity, expected, largest=FARTHEST)
        self.parameters[:, [layout.VELOCITY_X, layout.VELOCITY_Y]] = moving
        self.parameters.flags.writeable = False

    def moved(self, step: Array) -> "Shapes":
        """Return the same shapes a step (2,) [m] away."""
        elsewhere = copy(self)
        elsewhere.parameters = self.parameters.copy()
        self._class.shift(elsewhere.parameters, step)
        elsewhere.parameters.flags.writeable = False
        return elsewhere

    def __len__(self) -> int:
        """Return k."""
        return len(self.parameters)
