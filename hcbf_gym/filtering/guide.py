"""Guidance as the filter of N planar double integrators asks for it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    check_options,
    choose,
    warn_caller,
)
from hcbf_gym.filtering import axle_step
from hcbf_gym.filtering.samples import Samples
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.guidance.extent import CELL
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local


class Guide:
    """Where guidance leads N plants, if anything guides them.

    Args:
        choice: "geodesic", "local", a dict with more of it, or None.
        count: N.
        ahead: ℓ of differential drives, whose axles are led, and which turn before they go back; 0
            for all others [m].

    Attributes:
        guides: whether anything does.
        follows: whether it takes up maps that change, which may last longer than a step; else it
            leads by what it knew when its scene began.
        through: the highest rank that gives way to guidance, 0 for none.

    Raises:
        UnknownNameError: if there is no such guidance; the message lists the choices.
        InvalidInputError: on an unknown option.
    """

    def __init__(
        self,
        choice: str | Mapping[str, Any] | None,
        count: int,
        ahead: float = 0.0,
        cell: float = CELL,
    ):
        self._ahead = ahead
        self._guidance: Geodesic | Local | None = None
        self.guides, self.follows = choice is not None, True
        self.through = 0
        if choice is not None:
            options = dict(choice) if isinstance(choice, Mapping) else {"kind": choice}
            check_options("guidance", options, ("kind", "through"))
            self.through = int(options.get("through", 0))
            kinds: dict[str, Callable[[], Geodesic | Local]] = {
                "geodesic": lambda: Geodesic(count, through=self.through, cell=cell),
                "local": lambda: Local(count),
            }
            self._guidance = choose("guidance", options.get("kind", "geodesic"), kinds)()

    def begin(
        self,
        scenes: BarrierSet,
        samples: Samples,
        clearance: float,
        world: tuple[Any, Any],
        mask: Mask,
    ) -> None:
        """Look at the scenes that begin.

        Args:
            scenes: of all plants.
            samples: of them.
            clearance: what strict edges keep [m].
            world: the goal and the extent, as the plant gives them [m].
            mask: (N,) which scenes begin.
        """
        if isinstance(self._guidance, Local):
            self._guidance.reset(scenes, mask=mask)
        elif self._guidance is not None:
            place = samples.x[:, :2]
            start, time = (np.where(np.isfinite(a), a, 0.0) for a in (place, samples.time))
            goal, extent = world
            self._guidance.reset(scenes, goal, extent, clearance, start=start, mask=mask, time=time)

    def lead(self, scenes: BarrierSet, samples: Samples, u_nominal: Array) -> None:
        """Write where guidance leads the plants now into their records."""
        guide, plants = self._guidance, samples.plants
        if isinstance(guide, Local):
            guide.barriers = scenes
            guide.write_rows(samples.x, samples.time, u_nominal, plants["way"])
        elif guide is not None:
            if self.follows:
                self._follow(guide, scenes, samples)
            guide.update(samples.time)
            x, place = self._led(guide, samples), guide.geometry
            guidance_row.rows(guide.field, place, guide.goal, x, guide.pull, plants["way"])
            ranks = plants["reachable"], plants["zone"]
            guidance_row.ranks_at(guide.through, guide.zone, place, x, *ranks)
            if self._ahead > 0.0:
                axle_step.face(plants, u_nominal, guide.pull.gain, self._ahead)

    def _follow(self, guide: Geodesic, scenes: BarrierSet, samples: Samples) -> None:
        """Take up maps that have changed; of one on another grid guidance knows nothing."""
        try:
            guide.follow(scenes, samples.time)
        except InvalidInputError as error:
            warn_caller(f"{error}; it leads as before", SafetyWarning)

    def _led(self, guide: Geodesic, samples: Samples) -> Array:
        """Return (N, 4) what is led: position [m] and the velocity of the reduced-order model.

        Of a differential drive it is the axle, as the point before it may be beyond an edge; at the
        goal it is the point, which is to arrive there.
        """
        if self._ahead == 0.0:
            return samples.x
        x, heading = samples.x.copy(), samples.plants["heading"]
        left = np.linalg.norm(x[:, :2] - guide.goal, axis=1, keepdims=True)
        e = np.column_stack([np.cos(heading), np.sin(heading)])
        x[:, :2] -= np.where(left > guide.pull.look_ahead, self._ahead, 0.0) * e
        return x
