r"""A differential drive: an axle that moves along its heading, and a point ahead of it.

The axle p rolls along its heading e at the speed v and turns at the rate ω. The point p + ℓ e moves
in any direction, at the velocity ``v e + ℓ ω e⊥``. It is the point of the reduced-order model,
``p̈ = u``. Over a period T an input u changes the commanded v and ω to

.. math:: v' = v + T\, e·u, \qquad ω' = ω + (T/ℓ)\, e_⊥·u,

so that the axle accelerates by ``(e·u) e + v ω' e⊥``: along its heading as u does, and across it
because it turns while it rolls. The limits of the acceleration, v and ω make U a rectangle that is
aligned with the heading.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.errors import finite_float


class Axle(NamedTuple):
    """The limits of a differential drive.

    Attributes:
        look_ahead: ℓ, the distance from the axle to the point that follows the model [m].
        forward: V, the greatest speed forwards and backwards [m/s].
        turn: Ω, the greatest turning rate [rad/s].
        braking: A, the greatest acceleration along the heading [m/s²]. Across the heading the point
            accelerates by A at most, and by no more than turns the axle at Ω within 0.25 s.
    """

    look_ahead: float
    forward: float
    turn: float
    braking: float

    def checked(self) -> "Axle":
        """Return this record if all its numbers are valid.

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
        """The greatest norm of the axle's acceleration [m/s²]."""
        return float(np.hypot(self.braking, self.forward * self.turn))

    @property
    def hardest_of_point(self) -> float:
        """The greatest norm of an input, the acceleration of the point [m/s²]."""
        return float(np.hypot(self.braking, self.across))

    def jerk(self, period: float) -> float:
        """Return by how much the mean acceleration over T [s] may differ from the row's [m/s²].

        In products with u, rows use the present turning rate, although u changes it by up to
        ``Δ = min(A⊥ T/ℓ, 2 Ω)``. The difference is at most ``A Δ T + V Δ² T/2``.
        """
        change = min(self.across * period / self.look_ahead, 2.0 * self.turn)
        return (self.braking + 0.5 * self.forward * change) * change * period

    def strays(self, period: float) -> float:
        """Return by how much h − m may be less than its row ensures after a hold of T [m].

        The path deviates by ``j T³/12``, with ``j = V Ω² + 2 A Ω``, from one of constant mean
        acceleration. That acceleration differs from the row's by `jerk`.
        """
        change_rate = self.forward * self.turn**2 + 2.0 * self.braking * self.turn
        return change_rate * period**3 / 12.0 + 0.5 * self.jerk(period) * period**2
