"""What rows of any h reserve for the uncertainty of N plants of any model."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel


class Entry(NamedTuple):
    """A barrier that is no built-in shape, so that Python evaluates it, and its row."""

    scene: int  # of N
    place: int  # of m
    barrier: Barrier


class Known(NamedTuple):
    """The states of N plants, with what is uncertain of them."""

    x: Array  # (N, n) as the rows read it
    time: Array  # (N,) [s]
    model: Array  # (N, n) the reduced-order model's own state
    lag: Array  # (N, n) the body's minus the model's
    covariance: Array  # (N, n, n) P of x


class Reserve:
    """What the rows of N plants of one model reserve.

    Args:
        model: ẋ = f(x) + g(x)u.
        input_set: U.
        uncertainty: what the rows reserve, `fixed` included in its distance.
        fixed: the part of it that is in the unit of h: against dips, or given by hand.
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
        scene: tuple[Integers, Array],
        least: Array,
        entries: Sequence[Entry],
        known: Known,
        growth: Array,
        out: Array,
    ) -> None:
        """Write into rows (N, m, WIDTH + n_u), from `rows.MARGIN` to `FAST`, what they reserve.

        Args:
            scene: kind (N, m) and parameters (N, m, WIDTH).
            least: (N, m) what a row reserves itself.
            entries: those that are no built-in shapes; none where nothing of them is reserved.
            known: of the plants.
            growth: (N,) of the drift's covariance until the next sample.
            out: the rows.
        """
        of_inputs, settings = largest(self._input_set), np.array(self.settings)
        of = _core.Reserve(compiled(self._model), settings, of_inputs, self._period, len(least))
        sloping = slopes(entries, known, self.settings, least.shape[1])
        of.write(*known, growth, *scene, least, *sloping, self._model.n_p, out)


def largest(input_set: InputSet) -> Array:
    """Return (n_u,) the largest size of each input in U."""
    axes = np.eye(input_set.n_u)
    return np.array([max(input_set.support(one), input_set.support(-one)) for one in axes])


def slopes(
    entries: Sequence[Entry], known: Known, settings: Uncertainty, m: int
) -> tuple[Array, Array]:
    """Return ∇h (N, m, n) and what h may lose in second order (N, m); NaN of unreadable entries.

    Args:
        entries: the barriers that are no built-in shapes.
        known: of the plants.
        settings: what a deviation reserves.
        m: how many places a scene has.
    """
    x, time = known.x, known.time
    gradient, bend = np.zeros((len(x), m, x.shape[1])), np.zeros((len(x), m))
    if not entries:
        return gradient, bend
    off = x - (known.model + known.lag)
    values, vectors = np.linalg.eigh(known.covariance)
    scale = _core.margin_of_deviation(np.array(settings), 1.0)
    root = scale * np.swapaxes(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :], 1, 2)
    together: dict[tuple[int, int], list[Entry]] = {}
    for entry in entries:
        together.setdefault((entry.place, id(entry.barrier)), []).append(entry)
    for alike in together.values():
        k, barrier, scenes = alike[0].place, alike[0].barrier, [one.scene for one in alike]
        try:
            if len(scenes) == 1:
                one = barrier.jet(x[scenes[0]], float(time[scenes[0]]))
                gradient[scenes, k], hessian = one.gradient, np.asarray(one.hessian)[None]
            else:
                jets = barrier.batch(x[scenes], time[scenes])
                gradient[scenes, k], hessian = jets.gradient, np.asarray(jets.hessian)
            of_spread = root[scenes] @ hessian @ np.swapaxes(root[scenes], 1, 2)
            least = np.linalg.eigvalsh(of_spread)[:, 0]
            of_off = (off[scenes, None] @ hessian @ off[scenes][..., None])[:, 0, 0]
            bend[scenes, k] = -0.5 * (np.minimum(least, 0.0) + np.minimum(of_off, 0.0))
        except UNREADABLE:
            gradient[scenes, k] = np.nan
    return gradient, bend
