r"""A differential drive: an axle that moves along its heading, and the point before it.

The axle p rolls along its heading e at the speed v and turns at the rate ω. The point p + ℓ e moves
in any direction, at the velocity ``v e + ℓ ω e⊥``: it is the reduced-order model's, ``p̈ = u``. Over
a period T an input u changes what the robot is commanded by

.. math:: v' = v + T\, e·u, \qquad ω' = ω + (T/ℓ)\, e_⊥·u,

so that the axle accelerates by ``(e·u) e + v ω' e⊥``: along its heading as u does, across it as far
as it turns while it rolls. What limits a, v and ω is a rectangle of inputs along the heading.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.errors import finite_float


class Axle(NamedTuple):
    """What limits a differential drive.

    Attributes:
        look_ahead: ℓ, how far before the axle the point is that follows the model [m].
        forward: the greatest speed ahead and back, V [m/s].
        turn: the greatest turning rate, Ω [rad/s].
        braking: the greatest acceleration along the heading, A [m/s²]; across it the point has no
            more than that, and no more than turns the axle at Ω within 0.25 s.
    """

    look_ahead: float
    forward: float
    turn: float
    braking: float

    def checked(self) -> "Axle":
        """Return this record.

        Raises:
            InvalidInputError: if a number is not positive.
        """
        for name, value in self._asdict().items():
            finite_float(f"axle: {name}", value, minimum=0.0, exclusive=True)
        return self

    @property
    def across(self) -> float:
        """The greatest acceleration of the point across the heading, A⊥ [m/s²]."""
        return _core.axle_across(self)

    @property
    def hardest(self) -> float:
        """The greatest acceleration of the axle, along and across its heading [m/s²]."""
        return float(np.hypot(self.braking, self.forward * self.turn))

    @property
    def hardest_of_point(self) -> float:
        """The greatest norm of an input [m/s²]."""
        return float(np.hypot(self.braking, self.across))

    def jerk(self, period: float) -> float:
        """Return by how much the mean acceleration over T [s] may miss that of its row [m/s²].

        Rows take the turning rate that u changes for the present one in products with u: with
        ``Δ = min(A⊥ T/ℓ, 2 Ω)`` they miss ``A Δ T + V Δ² T/2``.
        """
        change = min(self.across * period / self.look_ahead, 2.0 * self.turn)
        return (self.braking + 0.5 * self.forward * change) * change * period

    def strays(self, period: float) -> float:
        """Return by how much h − m may be less than its row promises at the end of a hold T [m].

        The path strays from that of a constant mean acceleration by ``j T³/12``, with
        ``j = V Ω² + 2 A Ω``, and the mean acceleration from the row's by `jerk`.
        """
        fastest = self.forward * self.turn**2 + 2.0 * self.braking * self.turn
        return fastest * period**3 / 12.0 + 0.5 * self.jerk(period) * period**2
