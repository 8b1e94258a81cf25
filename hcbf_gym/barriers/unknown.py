"""Margins that rows of any h and any model reserve for uncertain states (`model_margins.hpp`)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel


class Entry(NamedTuple):
    """A barrier that Python evaluates, as it is no built-in shape, and where its row is."""

    scene: int  # index of its scene among N
    place: int  # index of its row among m
    barrier: Barrier


class UncertainStates(NamedTuple):
    """The estimated states of N plants and their uncertainty."""

    x: Array  # (N, n) as the rows read it
    time: Array  # (N,) [s]
    model: Array  # (N, n) the reduced-order model's own state
    lag: Array  # (N, n) the body's state minus the model's
    covariance: Array  # (N, n, n) P of x


class Slopes(NamedTuple):
    """Derivatives of m barriers at N uncertain states."""

    gradient: Array  # (N, m, n) ∇h
    loss: Array  # (N, m) by how much h may fall in second order, within the uncertainty [unit of h]


class Reserve:
    """Derives the margins of the rows of N plants of one model.

    Args:
        model: ẋ = f(x) + g(x)u.
        input_set: U.
        uncertainty: what the rows reserve, `fixed` included in its distance.
        fixed: the part of that distance in the unit of h: against dips, or given by hand.
        period: T [s]; None where it is not known.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        input_set: InputSet,
        uncertainty: Uncertainty,
        fixed: float,
        period: float | None,
    ) -> None:
        self.fixed = fixed
        self.settings = uncertainty._replace(distance=max(0.0, uncertainty.distance - fixed))
        self.is_steep = self.settings.distance + self.settings.body > 0.0
        self._model, self._input_set, self._period = model, input_set, period or 0.0

    def write(
        self,
        scenes: BarrierSet,
        entries: Sequence[Entry],
        states: UncertainStates,
        growth: Array,
        out: Array,
    ) -> None:
        """Write the margin columns of rows, from `rows.MARGIN` to `rows.FAST`.

        Args:
            scenes: of the N plants, m barriers in each.
            entries: the barriers for whose ∇h a margin is reserved; none where none is.
            states: of the plants.
            growth: (N,) of the covariance of the velocity until the next sample [m²/s²].
            out: (N, m, WIDTH + n_u) the rows.
        """
        count, m = scenes.kind.shape
        sizes, settings = largest_inputs(self._input_set), np.array(self.settings)
        core = _core.Reserve(compiled(self._model), settings, sizes, self._period, count)
        slopes = slopes_of(entries, states, self.settings, m)
        barriers = scenes.kind, scenes.parameters, scenes.own_margin + self.fixed
        core.write(*states, growth, *barriers, *slopes, self._model.n_p, out)


def largest_inputs(input_set: InputSet) -> Array:
    """Return (n_u,) the largest size of each input in U."""
    axes = np.eye(input_set.n_u)
    return np.array([max(input_set.support(one), input_set.support(-one)) for one in axes])


def slopes_of(
    entries: Sequence[Entry], states: UncertainStates, reserved: Uncertainty, m: int
) -> Slopes:
    """Return the slopes of barriers that Python evaluates; ∇h is NaN where one is unreadable.

    Args:
        entries: these barriers.
        states: of the N plants.
        reserved: what a deviation reserves.
        m: the number of rows of a scene.
    """
    x, time = states.x, states.time
    gradient, loss = np.zeros((len(x), m, x.shape[1])), np.zeros((len(x), m))
    if not entries:
        return Slopes(gradient, loss)
    error = x - (states.model + states.lag)
    values, vectors = np.linalg.eigh(states.covariance)
    scale = _core.margin_of_deviation(np.array(reserved), 1.0)
    root = scale * np.swapaxes(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :], 1, 2)
    shared: dict[tuple[int, int], list[Entry]] = {}
    for entry in entries:
        shared.setdefault((entry.place, id(entry.barrier)), []).append(entry)
    for sharing in shared.values():
        k, barrier, scenes = sharing[0].place, sharing[0].barrier, [one.scene for one in sharing]
        try:
            if len(scenes) == 1:
                jet = barrier.jet(x[scenes[0]], float(time[scenes[0]]))
                gradient[scenes, k], hessian = jet.gradient, np.asarray(jet.hessian)[None]
            else:
                jets = barrier.batch(x[scenes], time[scenes])
                gradient[scenes, k], hessian = jets.gradient, np.asarray(jets.hessian)
            spread = root[scenes] @ hessian @ np.swapaxes(root[scenes], 1, 2)
            by_spread = np.linalg.eigvalsh(spread)[:, 0]
            by_error = (error[scenes, None] @ hessian @ error[scenes][..., None])[:, 0, 0]
            loss[scenes, k] = -0.5 * (np.minimum(by_spread, 0.0) + np.minimum(by_error, 0.0))
        except UNREADABLE:
            gradient[scenes, k] = np.nan
    return Slopes(gradient, loss)
