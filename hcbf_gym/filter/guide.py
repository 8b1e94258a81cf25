"""Guidance of N planar double integrators, which becomes a row of the program or shapes u*."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, SafetyWarning, check_options, choose, warn_caller
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.origin import World
from hcbf_gym.filter.samples import Samples
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local


class Guide:
    """Leads N plants to their goals, by what it writes into their records for the core.

    Attributes:
        guides: whether there is guidance: `settings.guidance` is not None.
        has_row: whether guidance is a row of the last rank; if not, it shapes u*.
        follows: whether it takes up goals that move and maps that change, which may last longer
            than a step. If not, it leads by what it knew at `begin`.

    Raises:
        UnknownNameError: if there is no such guidance; the message lists the choices.
        InvalidInputError: on an unknown option, or a model that is not guided.
    """

    def __init__(self, config: FilterConfig, samples: Samples):
        self._config, self._samples = config, samples
        choice, axle = config.settings.guidance, config.plant.axle
        self.guides, self.follows = choice is not None, True
        self._look_ahead = 0.0 if axle is None else axle.look_ahead
        self._world = World(None, None)
        self._lost = np.zeros(config.count, dtype=np.bool_)
        self._guidance: Geodesic | Local | None = None
        through = 0
        if choice is not None:
            if not config.is_planar:
                raise InvalidInputError(
                    f"guidance: got {choice!r} with {type(config.plant.model).__name__}, expected "
                    "None: only the planar double integrator is guided"
                )
            is_named = not isinstance(choice, Mapping)
            options: dict[str, Any] = {"kind": choice} if is_named else dict(choice)
            check_options("guidance", options, ("kind", "through"))
            through = int(options.get("through", 0))
            kind = options.get("kind", "geodesic")
            if choose("guidance", kind, {"geodesic": Geodesic, "local": Local}) is Local:
                self._guidance = Local(config.count)
            else:
                self._guidance = Geodesic(config.count, through=through, cell=config.cell)
        config.constants["has_way"], config.constants["through"] = self.guides, through
        self.has_row = self.guides and bool(config.constants["guided"][0])

    def begin(self, scenes: BarrierSet, world: World, mask: Mask, is_first: bool) -> None:
        """Find paths in the scenes of episodes that begin.

        Args:
            scenes: of all plants.
            world: the goal and the extent, as the plant's readers return them.
            mask: (N,) the plants whose episodes begin.
            is_first: whether a malformed world is refused; if not, it has no path.
        """
        guide, samples = self._guidance, self._samples
        try:
            if isinstance(guide, Local):
                guide.reset(scenes, mask=mask)
            elif guide is not None:
                self._world = deepcopy(samples.origin.world(world)) or World(None, None)
                place = samples.x[:, :2]
                start, time = (np.where(np.isfinite(a), a, 0.0) for a in (place, samples.time))
                clearance = self._config.clearance
                guide.begin(scenes, *self._world, clearance, start=start, mask=mask, t=time)
        except InvalidInputError as error:
            if is_first:
                raise
            if isinstance(guide, Geodesic):
                guide.lose(str(error))
        self._update_lost()

    def why(self, plants: Mask) -> str:
        """Return why no path leads to the goal of the first lost one of the masked plants (N,)."""
        lost = self._guidance.lost if isinstance(self._guidance, Geodesic) else {}
        why = next((lost[i] for i in np.flatnonzero(plants).tolist() if i in lost), "")
        origin = self._samples.origin
        far = f" (positions count from {origin.at.tolist()} here)" if why and origin.is_far else ""
        return why + far

    def lead(self, scenes: BarrierSet, u_nominal: Array, world: World | None) -> None:
        """Write into the records where guidance leads the plants now.

        Args:
            scenes: of all plants.
            u_nominal: (N, n_u) u* [m/s²].
            world: the present one, as in `begin`; None if it is as it was.
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
            x, place = self._led_states(guide), guide.geometry
            _core.guidance_rows(guide.field, place, guide.goal, x, guide.pull, plants["way"])
            ranks = plants["reachable"], plants["zone"]
            _core.guidance_ranks(guide.through, guide.zone, place, x, *ranks)
            if self._look_ahead > 0.0:
                _core.face(samples.words, u_nominal, guide.pull.gain, self._look_ahead)

    def _follow(self, guide: Geodesic, scenes: BarrierSet) -> None:
        """Take up changed maps; warn, and lead as before, if the grid is another one."""
        try:
            guide.follow(scenes, self._samples.time)
        except InvalidInputError as error:
            warn_caller(f"{error}; it leads as before", SafetyWarning)

    def _pursue(self, guide: Geodesic, scenes: BarrierSet, world: World | None) -> None:
        """Take up a changed world; look again for the paths that were not found."""
        before, samples = self._world, self._samples
        if world is not None and not all(map(_is_same, world, before)):
            self._world = deepcopy(world)
        elif not guide.lost:
            return
        anew = not _is_same(self._world.extent, before.extent)
        try:
            guide.pursue(scenes, *self._world, samples.x[:, :2], samples.time, anew)
        except InvalidInputError as error:
            guide.lose(str(error))
        self._update_lost()

    def _update_lost(self) -> None:
        """Set which plants (N,) have no path to their goal."""
        if isinstance(self._guidance, Geodesic):
            self._lost[:] = False
            self._lost[list(self._guidance.lost)] = True

    def _led_states(self, guide: Geodesic) -> Array:
        """Return (N, 4) the positions [m] that are led, and velocities of the model [m/s].

        Of a differential drive the axle is led, as the point before it may be beyond an edge. Near
        the goal it is the point, which has to arrive there.
        """
        samples = self._samples
        if self._look_ahead == 0.0:
            return samples.x
        x, heading = samples.x.copy(), samples.plants["heading"]
        distance = np.linalg.norm(x[:, :2] - guide.goal, axis=1, keepdims=True)
        forward = np.column_stack([np.cos(heading), np.sin(heading)])
        x[:, :2] -= np.where(distance > guide.pull.look_ahead, self._look_ahead, 0.0) * forward
        return x


def _is_same(one: Any, other: Any) -> bool:
    """Return whether a goal or an extent equals that of before."""
    if one is None or other is None:
        return one is other
    try:
        return bool(np.array_equal(one, other))
    except Exception:  # a foreign object may raise anything
        return False
