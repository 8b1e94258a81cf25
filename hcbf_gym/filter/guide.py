"""Guidance of N planar double integrators, which becomes a row of the program or shapes u*."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    check_options,
    choose,
    in_words,
    reals,
    warn_caller,
)
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.origin import World
from hcbf_gym.filter.samples import Samples
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local


class Guide:
    """Guides N plants to their goals, by the fields of their records that the core reads.

    Attributes:
        guides: whether there is guidance: `settings.guidance` is not None.
        has_row: whether guidance is a row of the last rank; if not, it shapes u*.
        follows: whether moved goals and changed maps are taken up at every step, which may take
            longer than a period. If not, guidance uses the world of `begin`.

    Raises:
        UnknownNameError: if there is no such guidance; the message lists the choices.
        InvalidInputError: if an option is unknown, or guidance is requested for another model than
            the planar double integrator.
    """

    def __init__(self, config: FilterConfig, samples: Samples):
        self._config, self._samples = config, samples
        axle = config.plant.axle
        self._look_ahead = 0.0 if axle is None else axle.look_ahead
        self._world = World(None, None)
        self._is_lost = np.zeros(config.count, dtype=np.bool_)
        self._guidance, through = self._make_guidance()
        self.guides, self.follows = self._guidance is not None, True
        config.constants["has_way"], config.constants["through"] = self.guides, through
        self.has_row = self.guides and bool(config.constants["guided"][0])

    def _make_guidance(self) -> tuple[Geodesic | Local | None, int]:
        """Return the guidance or None, and the highest rank that is relaxed for it or 0."""
        config = self._config
        requested = config.settings.guidance
        if requested is None:
            return None, 0
        if not config.is_planar:
            raise InvalidInputError(
                f"guidance: got {requested!r} with {type(config.plant.model).__name__}, expected "
                "None: only the planar double integrator is guided"
            )
        is_mapping = isinstance(requested, Mapping)
        options: dict[str, Any] = dict(requested) if is_mapping else {"kind": requested}
        check_options("guidance", options, ("kind", "through"))
        through = int(options.get("through", 0))
        kind = options.get("kind", "geodesic")
        if choose("guidance", kind, {"geodesic": Geodesic, "local": Local}) is Local:
            return Local(config.count), through
        return Geodesic(config.count, through=through, cell=config.cell), through

    def begin(self, scenes: BarrierSet, world: World, mask: Mask, is_first: bool) -> None:
        """Find paths in the scenes of episodes that begin.

        Args:
            scenes: the scenes of all plants.
            world: the goal and the extent, as the plant's readers return them.
            mask: (N,) the plants whose episodes begin.
            is_first: whether a malformed world is refused; if not, no path leads to its goal.
        """
        guidance, samples = self._guidance, self._samples
        try:
            if isinstance(guidance, Local):
                guidance.reset(scenes, mask=mask)
            elif guidance is not None:
                self._world = _copied(samples.origin.world(world))
                start = np.nan_to_num(samples.x[:, :2], posinf=0.0, neginf=0.0)
                time = np.nan_to_num(samples.time, posinf=0.0, neginf=0.0)
                clearance = self._config.clearance
                guidance.begin(scenes, *self._world, clearance, start=start, mask=mask, t=time)
        except Exception as error:  # a user's goal or barrier may raise anything
            if is_first:
                raise
            if isinstance(guidance, Geodesic):
                guidance.lose(in_words(error))
        self._update_lost()

    def why_lost(self, plants: Iterable[int]) -> str:
        """Return why no path leads to the goal of the first lost plant among indices, or ""."""
        reasons = self._guidance.lost if isinstance(self._guidance, Geodesic) else {}
        reason = next((reasons[i] for i in plants if i in reasons), "")
        origin = self._samples.origin
        if reason and origin.is_far:
            reason += f" (positions count from {origin.at.tolist()} here)"
        return reason

    def lead(self, scenes: BarrierSet, u_nominal: Array, world: World | None) -> None:
        """Write the present guidance of the plants into their records.

        Args:
            scenes: the scenes of all plants.
            u_nominal: (N, n_u) u* [m/s²].
            world: the present goal and extent, as in `begin`; None if they have not changed.
        """
        guidance, samples, plants = self._guidance, self._samples, self._samples.plants
        if isinstance(guidance, Local):
            guidance.barriers = scenes
            guidance.write_rows(samples.x, samples.time, u_nominal, plants["way"])
        elif guidance is not None:
            if self.follows:
                self._follow_maps(guidance, scenes)
                self._pursue_goals(guidance, scenes, samples.origin.world(world))
            plants["lost"] = self._is_lost
            guidance.update(samples.time)
            x, grid, pull = self._led_states(guidance), guidance.geometry, guidance.pull
            _core.guidance_rows(guidance.field, grid, guidance.goal, x, pull, plants["way"])
            ranks = plants["reachable"], plants["zone"]
            _core.guidance_ranks(guidance.through, guidance.zone, grid, x, *ranks)
            if self._look_ahead > 0.0:
                _core.face(samples.words, u_nominal, pull.gain, self._look_ahead)

    def _follow_maps(self, guidance: Geodesic, scenes: BarrierSet) -> None:
        """Take up changed maps; if a map has another grid, warn and keep the previous one."""
        try:
            guidance.follow(scenes, self._samples.time)
        except Exception as error:  # a user's barrier may raise anything
            warn_caller(f"{in_words(error)}; it leads as before", SafetyWarning)

    def _pursue_goals(self, guidance: Geodesic, scenes: BarrierSet, world: World | None) -> None:
        """Take up changed goals and extents; look again for the paths that were not found."""
        previous, samples = self._world, self._samples
        is_same_world = world is None or all(map(_are_equal, world, previous))
        if is_same_world and not guidance.lost:
            return
        if world is not None and not is_same_world:
            self._world = _copied(world)
        is_other_extent = not _are_equal(self._world.extent, previous.extent)
        position, time = samples.x[:, :2], samples.time
        try:
            guidance.pursue(scenes, *self._world, position, time, is_other_extent)
        except Exception as error:  # a user's goal or barrier may raise anything
            guidance.lose(in_words(error))
        self._update_lost()

    def _update_lost(self) -> None:
        """Set which plants (N,) have no path to their goal."""
        if isinstance(self._guidance, Geodesic):
            self._is_lost[:] = False
            self._is_lost[list(self._guidance.lost)] = True

    def _led_states(self, guidance: Geodesic) -> Array:
        """Return (N, 4) the positions that guidance leads [m], and the model's velocities [m/s].

        Guidance leads the axle of a differential drive, because the point before it may be beyond
        an edge. Near the goal it leads the point, which has to arrive there.
        """
        samples = self._samples
        if self._look_ahead == 0.0:
            return samples.x
        x, heading = samples.x.copy(), samples.plants["heading"]
        distance = np.linalg.norm(x[:, :2] - guidance.goal, axis=1, keepdims=True)
        forward = np.column_stack([np.cos(heading), np.sin(heading)])
        leads_axle = distance > guidance.pull.look_ahead
        x[:, :2] -= np.where(leads_axle, self._look_ahead, 0.0) * forward
        return x


def _copied(world: World | None) -> World:
    """Return a copy of a world, which its owner may edit; unreadable parts as they are."""
    return World(None, None) if world is None else World(*map(_copied_part, world))


def _copied_part(points: Any) -> Any:
    """Return a copy of a goal or an extent, which may be None."""
    try:
        return None if points is None else reals("points", points)
    except Exception:  # a foreign object may raise anything; guidance refuses it
        return points


def _are_equal(now: Any, before: Any) -> bool:
    """Return whether a goal or an extent, which may be None, has not changed."""
    if now is None or before is None:
        return now is before
    try:
        return bool(np.array_equal(now, before))
    except Exception:  # a foreign object may raise anything
        return False
