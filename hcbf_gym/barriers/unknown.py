"""Margins of rows of any barrier and model at uncertain states; see model_margins.hpp."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, checked
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel


class Entry(NamedTuple):
    """A barrier that Python evaluates, as it is no built-in shape, and the place of its row."""

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
    loss: Array  # (N, m) the second-order loss of h within the uncertainty [unit of h]


class Reserve:
    """Writes the margins of the rows of N plants of one model.

    A distance d lowers h by ``d ‖∇h‖``. Its `fixed` part is in the unit of h already and must not
    be scaled by the slope, so that it is taken out of d here and added to each margin in `write`.

    Args:
        model: ẋ = f(x) + g(x)u.
        input_set: U.
        uncertainty: what the rows reserve; its distance d includes `fixed`.
        fixed: the part of d against dips between samples, or set by the user [unit of h].
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
        self.is_steep = self.settings.distance + self.settings.body > 0.0  # ‖∇h‖ scales a margin
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
            scenes: m barriers of each of N plants.
            entries: the barriers that Python evaluates.
            states: the plants' states.
            growth: (N,) how much the velocity's variance grows in a period [m²/s²].
            out: (N, m, WIDTH + n_u) the rows.
        """
        count, m = scenes.kind.shape
        sizes, settings = largest_inputs(self._input_set), np.array(self.settings)
        core = _core.Reserve(compiled(self._model), settings, sizes, self._period, count)
        slopes = slopes_of(entries, states, self.settings, m)
        core.write(
            **states._asdict(),
            growth=growth,
            kind=scenes.kind,
            parameters=scenes.parameters,
            least=scenes.own_margin + self.fixed,
            gradient=slopes.gradient,
            bend=slopes.loss,
            n_p=self._model.n_p,
            out=out,
        )


def largest_inputs(input_set: InputSet) -> Array:
    """Return (n_u,) the largest size of each input in U."""
    axes = np.eye(input_set.n_u)
    return np.array([max(input_set.support(axis), input_set.support(-axis)) for axis in axes])


def slopes_of(
    entries: Sequence[Entry], states: UncertainStates, reserved: Uncertainty, m: int
) -> Slopes:
    r"""Return ∇h and the second-order loss of the barriers that Python evaluates.

    H is the Hessian of h, P = V Λ Vᵀ the covariance, κ what is reserved for a standard deviation
    of 1, and S = κ V Λ^½. The deviations that are reserved are S z, ‖z‖ ≤ 1. For them h falls in
    second order by at most ``½ max(0, −λ_min(Sᵀ H S))``. The known error e = x − x_body takes
    ``½ max(0, −eᵀ H e)`` more. ∇h is NaN where Python cannot read a barrier.

    Args:
        entries: these barriers, with their scenes and places.
        states: the states of the N plants.
        reserved: what the plant declares, and how a deviation becomes a margin.
        m: the number of rows of a scene.
    """
    x, time = states.x, states.time
    gradient, loss = np.zeros((len(x), m, x.shape[1])), np.zeros((len(x), m))
    if not entries:
        return Slopes(gradient, loss)
    error = x - (states.model + states.lag)
    variances, axes = np.linalg.eigh(states.covariance)
    scaled_axes = axes * np.sqrt(np.maximum(variances, 0.0))[:, None, :]  # V Λ^½
    scale = _core.margin_of_deviation(np.array(reserved), 1.0)  # κ
    root = scale * np.swapaxes(scaled_axes, 1, 2)  # Sᵀ (N, n, n)
    for barrier, k, plants in _by_barrier(entries):
        try:
            gradient[plants, k], hessian = _derivatives(barrier, x[plants], time[plants])
            loss[plants, k] = _second_order_loss(hessian, root[plants], error[plants])
        except Exception:  # a user's own barrier may raise anything
            gradient[plants, k] = np.nan
    return Slopes(gradient, loss)


def _by_barrier(entries: Sequence[Entry]) -> Iterator[tuple[Barrier, int, list[int]]]:
    """Yield each barrier with the place of its row and the scenes that share it."""
    sharing: dict[tuple[int, int], list[Entry]] = {}
    for entry in entries:
        sharing.setdefault((entry.place, id(entry.barrier)), []).append(entry)
    for (place, _), shared_entries in sharing.items():
        yield shared_entries[0].barrier, place, [entry.scene for entry in shared_entries]


def _derivatives(barrier: Barrier, x: Array, time: Array) -> tuple[Array, Array]:
    """Return ∇h (k, n) and H (k, n, n) at states x (k, n) and times (k,)."""
    if len(x) == 1:  # a single plant needs no method for batches
        jet = checked(barrier, barrier.jet(x[0], float(time[0])), x.shape[1], finite=False)
        return jet.gradient, jet.hessian[None]
    jets = checked(barrier, barrier.batch(x, time), x.shape[1], finite=False, count=len(x))
    return jets.gradient, jets.hessian


def _second_order_loss(hessian: Array, root: Array, error: Array) -> Array:
    """Return (k,) the loss that `slopes_of` defines, from H and Sᵀ (k, n, n), and e (k, n)."""
    spread = root @ hessian @ np.swapaxes(root, 1, 2)
    by_spread = np.linalg.eigvalsh(spread)[:, 0]
    by_error = (error[:, None] @ hessian @ error[..., None])[:, 0, 0]
    return -0.5 * (np.minimum(by_spread, 0.0) + np.minimum(by_error, 0.0))
