"""Guidance of N planar double integrators, as the filter requests it."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, SafetyWarning, check_options, choose, warn_caller
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.samples import Samples
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local

World = Sequence[Any]
"""The goal, and the extent or None, as a plant gives them [m]."""


class Guide:
    """Leads N plants, if `settings.guidance` is not None, by what it writes into their records.

    Attributes:
        guides: whether anything leads the plants.
        has_row: whether it is a row of the last rank, or shapes u*.
        follows: whether it takes up goals that move and maps that change, which may last longer
            than a step; else it leads by what it knew when its scene began.

    Raises:
        UnknownNameError: if there is no such guidance; the message lists the choices.
        InvalidInputError: on an unknown option, or a model that is not guided.
    """

    def __init__(self, config: FilterConfig, samples: Samples):
        self._config, self._samples = config, samples
        choice, axle = config.settings.guidance, config.plant.axle
        self.guides, self.follows = choice is not None, True
        self._ahead = 0.0 if axle is None else axle.look_ahead
        self._world: World = None, None
        self._lost = np.zeros(config.count, dtype=np.bool_)
        self._guidance: Geodesic | Local | None = None
        self._through = 0
        if choice is not None:
            if not config.is_planar:
                raise InvalidInputError(
                    f"guidance: got {choice!r} with {type(config.plant.model).__name__}, expected "
                    "None: only the planar double integrator is guided"
                )
            options: dict[str, Any] = (
                dict(choice) if isinstance(choice, Mapping) else {"kind": choice}
            )
            check_options("guidance", options, ("kind", "through"))
            self._through = int(options.get("through", 0))
            kinds: dict[str, Callable[[], Geodesic | Local]] = {
                "geodesic": lambda: Geodesic(config.count, through=self._through, cell=config.cell),
                "local": lambda: Local(config.count),
            }
            self._guidance = choose("guidance", options.get("kind", "geodesic"), kinds)()
        config.constants["has_way"], config.constants["through"] = self.guides, self._through
        self.has_row = self.guides and bool(config.constants["guided"][0])

    def begin(self, scenes: BarrierSet, world: World, mask: Mask, is_first: bool) -> None:
        """Look at the scenes that begin.

        Args:
            scenes: of all plants.
            world: the goal and the extent, as the plant gives them [m].
            mask: (N,) which scenes begin.
            is_first: whether what is malformed is refused; if not, no path leads there.
        """
        guide, samples = self._guidance, self._samples
        try:
            if isinstance(guide, Local):
                guide.reset(scenes, mask=mask)
            elif guide is not None:
                goal, extent = self._world = deepcopy(samples.origin.world(world)) or (None, None)
                place = samples.x[:, :2]
                start, time = (np.where(np.isfinite(a), a, 0.0) for a in (place, samples.time))
                clearance = self._config.clearance
                guide.begin(scenes, goal, extent, clearance, start=start, mask=mask, t=time)
        except InvalidInputError as error:
            if is_first:
                raise
            if isinstance(guide, Geodesic):
                guide.lose(str(error))
        self._note_lost()

    def why(self, plants: Mask) -> str:
        """Return why no path leads to the goal of the first of the masked plants (N,)."""
        lost = self._guidance.lost if isinstance(self._guidance, Geodesic) else {}
        why = next((lost[n] for n in np.flatnonzero(plants).tolist() if n in lost), "")
        origin = self._samples.origin
        far = f" (positions count from {origin.at.tolist()} here)" if why and origin.is_far else ""
        return why + far

    def lead(self, scenes: BarrierSet, u_nominal: Array, world: World | None) -> None:
        """Write where guidance leads the plants now into their records.

        Args:
            scenes: of all plants.
            u_nominal: (N, n_u) u*.
            world: as `begin` takes it, as the plant gives it now; None is as it was.
        """
        guide, samples, plants = self._guidance, self._samples, self._samples.plants
        if isinstance(guide, Local):
            guide.barriers = scenes
            guide.write_rows(samples.x, samples.time, u_nominal, plants["way"])
        elif guide is not None:
            if self.follows:
                self._follow(guide, scenes)
                self._pursue(guide, scenes, samples.origin.world(world))
            plants["lost"] = self._lost
            guide.update(samples.time)
            x, place = self._led(guide), guide.geometry
            _core.guidance_rows(guide.field, place, guide.goal, x, guide.pull, plants["way"])
            ranks = plants["reachable"], plants["zone"]
            _core.guidance_ranks(guide.through, guide.zone, place, x, *ranks)
            if self._ahead > 0.0:
                _core.face(samples.words, u_nominal, guide.pull.gain, self._ahead)

    def _follow(self, guide: Geodesic, scenes: BarrierSet) -> None:
        """Take up maps that have changed; of one on another grid guidance knows nothing."""
        try:
            guide.follow(scenes, self._samples.time)
        except InvalidInputError as error:
            warn_caller(f"{error}; it leads as before", SafetyWarning)

    def _pursue(self, guide: Geodesic, scenes: BarrierSet, world: World | None) -> None:
        """Take up goals and an extent that are others than before."""
        goal, extent = before = self._world
        if world is not None and not all(map(_same, world, before)):
            goal, extent = self._world = deepcopy(world)
        elif not guide.lost:
            return
        anew, samples = not _same(extent, before[1]), self._samples
        try:
            guide.pursue(scenes, goal, extent, samples.x[:, :2], samples.time, anew)
        except InvalidInputError as error:
            guide.lose(str(error))
        self._note_lost()

    def _note_lost(self) -> None:
        if isinstance(self._guidance, Geodesic):
            self._lost[:] = False
            self._lost[list(self._guidance.lost)] = True

    def _led(self, guide: Geodesic) -> Array:
        """Return (N, 4) what is led: position [m] and the velocity of the reduced-order model.

        Of a differential drive it is the axle, as the point before it may be beyond an edge; at the
        goal it is the point, which is to arrive there.
        """
        samples = self._samples
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
    except Exception:  # a foreign object may raise anything
        return False
