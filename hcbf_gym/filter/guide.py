"""Guidance as the filter of N planar double integrators asks for it."""

from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, SafetyWarning, check_options, choose, warn_caller
from hcbf_gym.filter.samples import Samples
from hcbf_gym.guidance.field import CELL
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local

World = tuple[Any, Any]
"""The goal, and the extent or None, as a plant gives them [m]."""


class Guide:
    """Where guidance leads N plants, if anything guides them.

    Args:
        choice: "geodesic", "local", a dict with more of it, or None.
        count: N.
        ahead: ℓ of differential drives, whose axles are led, and which turn before they go back; 0
            for all others [m].

    Attributes:
        guides: whether anything does.
        follows: whether it takes up goals that move and maps that change, which may last longer
            than a step; else it leads by what it knew when its scene began.
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
        self._clearance = 0.0
        self._world: World = None, None
        self._lost = np.zeros(count, dtype=np.bool_)
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
        world: World,
        mask: Mask,
    ) -> None:
        """Look at the scenes that begin.

        Args:
            scenes: of all plants.
            samples: of them.
            clearance: what strict edges keep [m].
            world: the goal and the extent, as the plant gives them [m].
            mask: (N,) which scenes begin.

        Raises:
            InvalidInputError: if goal or extent are malformed, or a barrier is a user's own.
        """
        self._clearance = clearance
        if isinstance(self._guidance, Local):
            self._guidance.reset(scenes, mask=mask)
        elif self._guidance is not None:
            self._world = deepcopy(world)
            place = samples.x[:, :2]
            start, time = (np.where(np.isfinite(a), a, 0.0) for a in (place, samples.time))
            self._guidance.begin(scenes, *world, clearance, start=start, mask=mask, t=time)
            self._note_lost(self._guidance)

    def why(self, plants: Mask) -> str:
        """Return why no path leads to the goal of the first of the masked plants (N,)."""
        lost = self._guidance.lost if isinstance(self._guidance, Geodesic) else {}
        return next((lost[n] for n in np.flatnonzero(plants).tolist() if n in lost), "")

    def lead(
        self, scenes: BarrierSet, samples: Samples, u_nominal: Array, world: World | None = None
    ) -> None:
        """Write where guidance leads the plants now into their records.

        Args:
            scenes: of all plants.
            samples: of them.
            u_nominal: (N, n_u) u*.
            world: as `begin` takes it, as the plant gives it now; None is as it was.
        """
        guide, plants = self._guidance, samples.plants
        if isinstance(guide, Local):
            guide.barriers = scenes
            guide.write_rows(samples.x, samples.time, u_nominal, plants["way"])
        elif guide is not None:
            if self.follows:
                self._follow(guide, scenes, samples)
                self._pursue(guide, scenes, samples, world)
            plants["lost"] = self._lost
            guide.update(samples.time)
            x, place = self._led(guide, samples), guide.geometry
            _core.guidance_rows(guide.field, place, guide.goal, x, guide.pull, plants["way"])
            ranks = plants["reachable"], plants["zone"]
            _core.guidance_ranks(guide.through, guide.zone, place, x, *ranks)
            if self._ahead > 0.0:
                _core.face(samples.words, u_nominal, guide.pull.gain, self._ahead)

    def _follow(self, guide: Geodesic, scenes: BarrierSet, samples: Samples) -> None:
        """Take up maps that have changed; of one on another grid guidance knows nothing."""
        try:
            guide.follow(scenes, samples.time)
        except InvalidInputError as error:
            warn_caller(f"{error}; it leads as before", SafetyWarning)

    def _pursue(
        self, guide: Geodesic, scenes: BarrierSet, samples: Samples, world: World | None
    ) -> None:
        """Take up goals and an extent that are others than before."""
        goal, extent = before = self._world
        if world is not None and not all(map(_same, world, before)):
            goal, extent = self._world = deepcopy(world)
        elif not guide.lost:
            return
        anew = not _same(extent, before[1])
        try:
            guide.pursue(scenes, goal, extent, samples.x[:, :2], samples.time, anew)
        except InvalidInputError as error:
            guide.lose(str(error))
        self._note_lost(guide)

    def lose(self, why: str) -> None:
        """Note why nothing is known of where plants are to be led."""
        if isinstance(self._guidance, Geodesic):
            self._guidance.lose(why)
            self._note_lost(self._guidance)

    def _note_lost(self, guide: Geodesic) -> None:
        self._lost[:] = False
        self._lost[list(guide.lost)] = True

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


def _same(one: Any, other: Any) -> bool:
    """Return whether a goal or an extent is what it was."""
    if one is None or other is None:
        return one is other
    try:
        return bool(np.array_equal(one, other))
    except Exception:  # whatever a foreign object raises when it is asked for its numbers
        return False
