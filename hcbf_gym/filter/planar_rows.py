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
from hcbf_gym.barriers.rows import MARGIN, USABLE, B
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Entry, UncertainStates
from hcbf_gym.errors import in_words
from hcbf_gym.filter.bound import Bound
from hcbf_gym.filter.configured import FilterConfig
from hcbf_gym.filter.row_maker import RowMaker
from hcbf_gym.filter.samples import Samples


class PlanarRows(RowMaker):
    """Makes the rows of users' own barriers; `make` is not called in scenes without any."""

    def __init__(self, config: FilterConfig, samples: Samples, bound: Bound):
        super().__init__(config, samples, bound)
        self._accepted: tuple[Barrier, ...] = ()

    def resize(self, m: int) -> None:
        """Allocate the rows (N, m, WIDTH + 2) of scenes of m barriers."""
        super().resize(m)
        self._rows.reads_position[...] = 1.0

    def accept(self, scenes: BarrierSet) -> ReachedBarriers:
        """Return users' own barriers in changed scenes; none if they are the same objects."""
        self.errors, barriers = {}, tuple(scenes.own.values())
        if are_same(barriers, self._accepted):
            return ReachedBarriers((), ())
        instant = instant_rows(self._config.row_settings)
        reaches = [instant.reach(barrier) for barrier in barriers]
        warn_of_concave(barriers, self._config.plant.model)
        self._accepted = barriers
        return ReachedBarriers(barriers, reaches)

    def forget(self) -> None:
        """Forget the accepted barriers."""
        self._accepted = ()

    def evaluate_previous(self, scenes: BarrierSet) -> bool:
        """Evaluate the previous scenes at the present states, unless users' own barriers are there.

        A step is VIOLATED if its strict conditions lack more than those of the previous scene did.
        The least h − m [m] and the least ψ [m/s] of that scene are written into the plants'
        records. All else that this evaluation changes is restored.
        """
        if scenes.own or scenes.kind.shape[1] != self._rows.numbers.shape[1]:
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
        """Return rows (N, m, WIDTH + 2), written for users' own barriers if u* (N, 2) is finite.

        The margin of each row is written first. b is NaN if a barrier is unreadable.
        """
        config, plants, rows = self._config, self._samples.plants, self._rows.numbers
        self.errors = {}
        if not np.isfinite(u_nominal).all():
            return rows
        self._bound.core.check_states()
        settings, margins = config.row_settings, config.row_margins
        entries = [Entry(i, k, barrier) for (i, k), barrier in scenes.own.items()]
        states = UncertainStates(*(plants[name].copy() for name in UncertainStates._fields))
        # only margins for an error of the position depend on slopes
        sloping = entries if self._samples.is_uncertain or margins.is_steep else []
        margins.write(scenes, sloping, states, plants["growth"].copy(), rows)
        look_ahead = 0.0 if config.plant.axle is None else config.plant.axle.look_ahead
        kinks = Kinks(u_nominal, self._warned_of_kinks)
        for i, k, barrier in entries:
            row = rows[i, k]
            x, t = plants["x"][i], float(plants["time"][i])
            try:
                if barrier.reads_position:  # the row is that of a point before the axle
                    row[MARGIN] += look_ahead
                reserved = Reserved(*row[MARGIN:USABLE].tolist())
                with np.errstate(all="ignore"):
                    write_own_row(barrier, x, t, settings, reserved, row, kinks.of_plant(i))
            except Exception as error:  # a user's own barrier may raise anything
                row[B] = np.nan
                self.errors[i] = in_words(error)
        return rows
