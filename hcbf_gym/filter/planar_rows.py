"""Rows of users' own barriers for N planar double integrators.

The compiled filter makes the rows of built-in shapes. Barriers of users' own classes are evaluated
here, in Python, and the compiled filter reads their finished rows.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.many import are_same
from hcbf_gym.barriers.planar_rows import Reserved, instant_rows, write_own_row
from hcbf_gym.barriers.relative_degree import ReachedBarriers
from hcbf_gym.barriers.rows import MARGIN, PLACED, USABLE, WIDTH, B
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, UncertainStates
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.samples import Samples, Snapshot


class PlanarRows:
    """Makes the rows of users' own barriers. `ModelRows` has the same methods for other models.

    `Scenes` calls them when barriers change, and `FilterCore` at every step.
    """

    def __init__(self, config: FilterConfig, samples: Samples, bound: Bound):
        self._config, self._samples, self._bound = config, samples, bound
        self._kinks = Kinks()
        self._accepted: tuple[Barrier, ...] = ()
        self.resize(0)

    def check(self, barriers: object, given: BarrierSet) -> None:
        """Accept all barriers: each has a row of this model."""

    def moves(self, scenes: BarrierSet) -> bool:
        """Return whether a barrier of N scenes depends on time."""
        return bool(scenes.moves.any())

    def resize(self, m: int) -> None:
        """Allocate the rows (N, m, WIDTH + 2) of scenes of m barriers."""
        self._rows: Array = np.zeros((self._config.count, m, WIDTH + 2))
        self._rows[..., PLACED] = 1.0

    def snapshot(self) -> Snapshot:
        """Return a copy of the samples, for `restore`."""
        return self._samples.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Set the samples back to a snapshot."""
        self._samples.restore(snapshot)

    def accept(self, scenes: BarrierSet) -> ReachedBarriers:
        """Return users' own barriers in changed scenes; none if they are the same objects."""
        barriers = tuple(scenes.own.values())
        if are_same(barriers, self._accepted):
            return ReachedBarriers((), ())
        self._accepted = ()  # an error below must not leave these barriers accepted
        instant = instant_rows(self._config.row_settings)
        reaches = [instant.reach(barrier) for barrier in barriers]
        warn_of_concave(barriers, self._config.plant.model)
        self._accepted = barriers
        return ReachedBarriers(barriers, reaches)

    def evaluate_previous(self, scenes: BarrierSet) -> bool:
        """Evaluate the scenes until now at the present states, for comparison with the next ones.

        A step is VIOLATED if its strict conditions lack more than those of the previous scene did.
        The least h − m [m] and the least ψ [m/s] of that scene are written into the plants'
        records. All else that this evaluation changes is restored.

        Returns:
            Whether the scenes could be evaluated. Scenes with users' own barriers are not.
        """
        if scenes.own or scenes.kind.shape[1] != self._rows.shape[1]:
            return False
        snapshot = self._samples.snapshot()
        self._bound.u_nominal[...] = 0.0
        self._bound.filter(scenes)
        plants = self._samples.plants
        least_values = {name: plants[name].copy() for name in ("kept", "headway")}
        self._samples.restore(snapshot)
        is_pending = plants["change"] != 0  # no step has seen an earlier change, which counts too
        for name, least in least_values.items():
            plants[name] = np.where(is_pending, np.maximum(plants[name], least), least)
        return True

    def make(self, scenes: BarrierSet, u_nominal: Array) -> Array:
        """Return rows (N, m, WIDTH + 2), written for users' own barriers if u* (N, 2) is finite."""
        self._kinks.u = u_nominal
        if np.isfinite(u_nominal).all():
            self._bound.core.check_states()
            self._reserve_and_write(scenes)
        return self._rows

    def _reserve_and_write(self, scenes: BarrierSet) -> None:
        """Write the margin of each row, then the row; b is NaN if a barrier is unreadable."""
        config, plants, rows = self._config, self._samples.plants, self._rows
        settings, reserve = config.row_settings, config.reserve
        entries = [Entry(i, k, barrier) for (i, k), barrier in scenes.own.items()]
        states = UncertainStates(*(plants[name].copy() for name in UncertainStates._fields))
        # only margins for an error of the position depend on slopes
        sloping = entries if self._samples.is_uncertain or reserve.is_steep else []
        reserve.write(scenes, sloping, states, plants["growth"].copy(), rows)
        look_ahead = 0.0 if config.plant.axle is None else config.plant.axle.look_ahead
        for i, k, barrier in entries:
            row, kinks = rows[i, k], self._kinks.starting_at(i)
            if barrier.reads_position:  # the row is that of a point before the axle
                row[MARGIN] += look_ahead
            reserved, t = Reserved(*row[MARGIN:USABLE].tolist()), float(plants["time"][i])
            try:
                with np.errstate(all="ignore"):
                    write_own_row(barrier, plants["x"][i], t, settings, reserved, row, kinks)
            except UNREADABLE:
                row[B] = np.nan
