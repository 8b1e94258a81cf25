"""Rows of N planar double integrators: the core makes them, but for users' own barriers."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.many import are_same
from hcbf_gym.barriers.planar_rows import usual, write_own_row
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.rows import MARGIN, PLACED, USABLE, WIDTH, B
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, Known
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.samples import Samples


class PlanarRows:
    """Makes the rows of users' own barriers, which the compiled filter reads."""

    def __init__(self, config: FilterConfig, samples: Samples, bound: Bound):
        self._config, self._samples, self._bound = config, samples, bound
        self._kinks = Kinks()
        self.widen(0)
        self._accepted: tuple[Barrier, ...] = ()

    def check(self, barriers: object, given: BarrierSet) -> None:
        """Refuse nothing: there are rows of all barriers."""

    def moves(self, scene: BarrierSet) -> bool:
        """Return whether a scene depends on time."""
        return bool(scene.moves.any())

    def widen(self, m: int) -> None:
        """Make room for m rows."""
        self._own: Array = np.zeros((self._config.count, m, WIDTH + 2))
        self._own[..., PLACED] = 1.0

    def remembered(self) -> Any:
        """Return what is known of the plants, for `restore`."""
        return self._samples.remembered()

    def restore(self, remembered: Any) -> None:
        """Know what was known before."""
        self._samples.restore(remembered)

    def accept(self, scene: BarrierSet) -> tuple[Sequence[Barrier], Sequence[Reach]]:
        """Return users' own barriers and how inputs reach them, if they are others than before."""
        own = tuple(scene.own.values())
        if are_same(own, self._accepted):
            return (), ()
        self._accepted = ()
        reaches = [usual(self._config.row_settings).reach(barrier) for barrier in own]
        warn_of_concave(own, self._config.plant.model)
        self._accepted = own
        return own, reaches

    def look_back(self, scene: BarrierSet) -> bool:
        """Write what strict conditions lack of the scene until now; return whether that is known.

        The filter answers as if the scene had stayed, and forgets that it did.
        """
        if scene.own or scene.kind.shape[1] != self._own.shape[1]:
            return False
        samples = self._samples
        before = samples.remembered()
        self._bound.u_nominal[...] = 0.0
        self._bound.filter(scene)
        plants = samples.plants
        least = {name: plants[name].copy() for name in ("kept", "headway")}
        samples.restore(before)
        unseen = plants["change"] != 0  # by any step: what was before that counts, too
        for name, now in least.items():
            plants[name] = np.where(unseen, np.maximum(plants[name], now), now)
        return True

    def make(self, scene: BarrierSet, u_nominal: Array) -> Array:
        """Return the rows (N, m, WIDTH + 2) of users' own barriers."""
        self._kinks.u = u_nominal
        if np.isfinite(u_nominal).all():
            self._make(scene)
        return self._own

    def _make(self, scene: BarrierSet) -> None:
        """Check the states, and make the rows."""
        config, plants, out = self._config, self._samples.plants, self._own
        self._bound.core.check_states()
        reach = 0.0 if config.plant.axle is None else config.plant.axle.look_ahead
        reserve = config.reserve
        known = Known(*(plants[name].copy() for name in Known._fields))
        entries = [Entry(i, k, barrier) for (i, k), barrier in scene.own.items()]
        least = scene.own_margin + reserve.fixed
        reserve.write(
            (scene.kind, scene.parameters), least,
            entries if self._samples.has_parts or reserve.is_steep else (),
            known, plants["growth"].copy(), out,
        )  # fmt: skip
        x, time = plants["x"], plants["time"]
        for i, k, barrier in entries:
            if barrier.reads_position:  # which binds the point before an axle
                out[i, k, MARGIN] += reach
            of_row = out[i, k, MARGIN:USABLE].tolist()
            try:
                with np.errstate(all="ignore"):
                    write_own_row(
                        barrier, x[i], float(time[i]), config.row_settings, of_row, out[i, k],
                        self._kinks.from_plant(i),
                    )  # fmt: skip
            except UNREADABLE:
                out[i, k, B] = np.nan
