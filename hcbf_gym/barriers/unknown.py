"""What is not known of N plants of any model, and what rows of any h reserve for it."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.margins import Several
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel

Entry = tuple[int, int, Barrier]
"""Scene, place and barrier of one that is no built-in shape."""


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

    def know(self, *state: Array) -> Several:
        """Return what is not known of N plants; see `several`."""
        return several(self._model, self._input_set, self.settings.confidence, state)

    def write(
        self,
        scene: tuple[Integers, Array],
        least: Array,
        entries: Sequence[Entry],
        known: Several,
        out: Array,
    ) -> None:
        """Write what the rows reserve.

        Args:
            scene: kind (N, m) and parameters (N, m, WIDTH).
            least: (N, m) what a row reserves by itself.
            entries: those that are no built-in shapes; none where nothing of them is reserved.
            known: of the plants.
            out: (N, m, 6) to be written: m, ṁ, m̈, leaning, what the body takes of h, and 1 where
                the body is faster than a speed limit.
        """
        confidence, shape = self.settings.confidence, out.shape[:2]
        gradient, bend = slopes(entries, known, confidence, (shape[0], shape[1]))
        rows = (*scene, least, gradient, bend, self._model.n_p)
        written = np.empty(out.shape)
        _core.margins_of_models(np.array(self.settings), *rows, *known, self._period, written)
        out[:] = written


def several(
    model: ReducedOrderModel,
    input_set: InputSet,
    confidence: float,
    state: Sequence[Array],
) -> Several:
    """Return what is not known of N plants; NaN where the model returns no numbers.

    The drift and what inputs do are compared at ``x ± κ L_j``, with ``P = L Lᵀ``.

    Args:
        model: ẋ = f(x) + g(x)u.
        input_set: U.
        confidence: κ.
        state: x (N, n), time (N,), the model's own state (N, n), lag (N, n) and P (N, n, n).
    """
    x, time, own, lag, covariance = state
    count, n = x.shape
    most = largest(input_set)
    body, placed = own + lag, model.n_p
    drift, turns = np.zeros((count, n, n)), np.zeros((count, 0, n, n))
    slip = np.zeros((count, 1, placed))
    try:
        if lag.any():
            (f, g), (f_own, g_own) = model.terms_of(body), model.terms_of(own)
            slip = np.zeros((count, 1 + model.n_u, placed))
            slip[:, 0] = (f - f_own)[:, :placed]
            slip[:, 1:] = np.moveaxis((g - g_own)[:, :placed] * most, 2, 1)
        if covariance.any() and confidence > 0.0:
            root = confidence * square_root(covariance)
            points = np.stack((x[:, None] + root, x[:, None] - root)).reshape(-1, n)
            f, g = model.terms_of(points)
            f, g = f.reshape(2, count, n, n), g.reshape(2, count, n, n, model.n_u)
            f, g = (f[0] - f[1]) / (2.0 * confidence), (g[0] - g[1]) * most / (2.0 * confidence)
            drift = _gram(f)
            if g.any():
                turns = np.stack([_gram(g[..., u]) for u in range(model.n_u)], axis=1)
    except UNREADABLE:
        drift[:] = slip[:] = np.nan
    growth = np.zeros(count)
    return Several(x, time, lag, x - body, slip, covariance, drift, growth, turns)


def _gram(a: Array) -> Array:
    """Return (N, q, q) ``Σ_j a_jᵀ a_j`` of a (N, n, q), summed in one order whatever N is."""
    total = np.zeros((len(a), a.shape[2], a.shape[2]))
    for j in range(a.shape[1]):
        total += a[:, j, :, None] * a[:, j, None, :]
    return total


def largest(input_set: InputSet) -> Array:
    """Return (n_u,) the largest size of each input in U."""
    axes = np.eye(input_set.n_u)
    return np.array([max(input_set.support(one), input_set.support(-one)) for one in axes])


def square_root(covariance: Array) -> Array:
    """Return (N, n, n) the rows L_j with ``P = Σ_j L_jᵀ L_j``, of P (N, n, n)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.swapaxes(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :], 1, 2)


def slopes(
    entries: Sequence[Entry], known: Several, confidence: float, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Return ∇h (N, m, n) and what h may lose in second order (N, m); NaN of what gives no numbers.

    Args:
        entries: scene, place and barrier of those that are no built-in shapes.
        known: of the plants.
        confidence: κ.
        shape: N and m.
    """
    n = known.x.shape[1]
    gradient, bend = np.zeros((*shape, n)), np.zeros(shape)
    if not entries:
        return gradient, bend
    root = confidence * square_root(known.state)
    together: dict[tuple[int, int], list[Entry]] = {}
    for entry in entries:
        together.setdefault((entry[1], id(entry[2])), []).append(entry)
    for alike in together.values():
        k, barrier, scenes = alike[0][1], alike[0][2], [i for i, _, _ in alike]
        try:
            if len(scenes) == 1:
                one = barrier.jet(known.x[scenes[0]], float(known.time[scenes[0]]))
                gradient[scenes, k], hessian = one.gradient, np.asarray(one.hessian)[None]
            else:
                jets = barrier.batch(known.x[scenes], known.time[scenes])
                gradient[scenes, k], hessian = jets.gradient, np.asarray(jets.hessian)
            off, spread = known.off[scenes], root[scenes]
            of_spread = spread @ hessian @ np.swapaxes(spread, 1, 2)
            least = np.linalg.eigvalsh(of_spread)[:, 0]
            of_off = (off[:, None] @ hessian @ off[..., None])[:, 0, 0]
            bend[scenes, k] = -0.5 * (np.minimum(least, 0.0) + np.minimum(of_off, 0.0))
        except UNREADABLE:
            gradient[scenes, k] = np.nan
    return gradient, bend
