"""Small dense steps of the stages, compiled: NumPy's calls would cost more than the solver."""

import math

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.tolerances import DEPENDENT, MET, NEGLIGIBLE, ZERO_GRADIENT


@kernel()
def unit_rows(a: Array, b: Array, least: float) -> tuple[Array, Array]:
    """Return the rows ``a x ≥ b`` scaled to unit norm, without those of norm `least` or below.

    Args:
        a: (k, n) rows.
        b: (k,) bounds.
        least: the norm up to which a row is a constant.
    """
    return _scaled_rows(a, b, least, False)


@kernel()
def level_rows(a: Array, b: Array, least: float) -> tuple[Array, Array]:
    """Return the rows ``a x ≥ b`` scaled to norms from 1/2 to 1, without those of norm `least`.

    They are scaled by powers of two: no digit is lost, and parallel rows stay parallel.

    Args: as :func:`unit_rows`.
    """
    return _scaled_rows(a, b, least, True)


@kernel()
def _scaled_rows(a: Array, b: Array, least: float, by_power: bool) -> tuple[Array, Array]:
    scaled = np.empty_like(a)
    bound = np.empty_like(b)
    kept = 0
    for k in range(b.size):
        square = 0.0
        for j in range(a.shape[1]):
            square += a[k, j] * a[k, j]
        norm = np.sqrt(square)
        if norm > least:
            divisor = math.ldexp(1.0, math.frexp(norm)[1]) if by_power else norm
            for j in range(a.shape[1]):
                scaled[kept, j] = a[k, j] / divisor
            bound[kept] = b[k] / divisor
            kept += 1
    return scaled[:kept], bound[:kept]


@kernel()
def whiten(a: Array, target: Array, centre: Array) -> tuple[Array, Array]:
    """Return R and R⁻ᵀ-image of the minimiser of ``‖z − c‖² + ‖a z − t‖²``: it is ``‖R z − y‖²``.

    R is upper triangular and comes from Givens rotations, row by row: squares are never formed.

    Args:
        a: (s, n) rows.
        target: (s,) t.
        centre: (n,) c.
    """
    n = centre.size
    factor = np.eye(n)
    y = centre.copy()
    for k in range(target.size):
        row = a[k].copy()
        t = target[k]
        for i in range(n):
            if row[i] == 0.0:
                continue
            length = np.hypot(factor[i, i], row[i])
            cos = factor[i, i] / length
            sin = row[i] / length
            for j in range(i, n):
                above = factor[i, j]
                below = row[j]
                factor[i, j] = cos * above + sin * below
                row[j] = cos * below - sin * above
            y[i], t = cos * y[i] + sin * t, cos * t - sin * y[i]
    return factor, y


@kernel()
def rows_of_image(rows: Array, factor: Array) -> Array:
    """Return ``rows R⁻¹`` (k, n): the rows as they act on y = R z."""
    image = rows.copy()
    for k in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            for i in range(j):
                image[k, j] -= image[k, i] * factor[i, j]
            image[k, j] /= factor[j, j]
    return image


@kernel()
def back_substitute(factor: Array, y: Array) -> Array:
    """Return z (n,) with ``R z = y``."""
    z = y.copy()
    for i in range(y.size - 1, -1, -1):
        for j in range(i + 1, y.size):
            z[i] -= factor[i, j] * z[j]
        z[i] /= factor[i, i]
    return z


@kernel()
def meets(a: Array, lower: Array, x: Array, tolerance: float) -> bool:
    """Return whether x (n,) misses no row by more than ``tolerance (1 + max|x|)``; NaN fails."""
    allowed = tolerance * (1.0 + (np.abs(x).max() if x.size else 0.0))
    for k in range(lower.size):
        value = 0.0
        for j in range(x.size):
            value += a[k, j] * x[j]
        if not lower[k] - value <= allowed:
            return False
    return allowed < np.inf


@kernel()
def with_slack(
    rows: Array, lower: Array, a: Array, target: Array, least: Array
) -> tuple[Array, Array]:
    """Return the rows on (z, s) of ``rows z ≥ lower``, ``a z + s ≥ target`` and ``s ≥ least``.

    Args:
        rows: (h, n) rows that no slack helps.
        lower: (h,) their bounds.
        a: (s, n) rows with a slack each; they come out with unit norm.
        target: (s,) their bounds.
        least: (s,) bounds of the slacks.
    """
    hard = lower.size
    free = rows.shape[1]
    count = target.size
    matrix, below = np.zeros((hard + 2 * count, free + count)), np.empty(hard + 2 * count)
    matrix[:hard, :free], below[:hard] = rows, lower
    for k in range(count):
        soft = hard + k
        alone = hard + count + k
        square = 1.0
        for j in range(free):
            square += a[k, j] * a[k, j]
        norm = np.sqrt(square)
        for j in range(free):
            matrix[soft, j] = a[k, j] / norm
        matrix[soft, free + k] = 1.0 / norm
        below[soft] = target[k] / norm
        matrix[alone, free + k] = 1.0
        below[alone] = least[k]
    return matrix, below


@kernel()
def complement(rows: Array, least: float) -> Array:
    """Return (n, r) an orthonormal basis of what is orthogonal to the rows (k, n).

    Args:
        rows: of unit norm.
        least: the singular value up to which a direction counts as orthogonal.
    """
    _, singular, orthogonal = np.linalg.svd(rows)
    return orthogonal[(singular > least).sum() :].T.copy()


@kernel()
def steepness(a: Array, basis: Array) -> tuple[Array, Array]:
    """Return (k,) how steep the rows a (k, n) are, and how steep in the directions of a basis."""
    whole, within = np.empty(a.shape[0]), np.empty(a.shape[0])
    for k in range(a.shape[0]):
        square = free = 0.0
        for j in range(a.shape[1]):
            square += a[k, j] * a[k, j]
        for i in range(basis.shape[1]):
            along = 0.0
            for j in range(a.shape[1]):
                along += a[k, j] * basis[j, i]
            free += along * along
        whole[k], within[k] = np.sqrt(square), np.sqrt(free)
    return whole, within


@kernel()
def pin(rows: Array, bounds: Array, basis: Array, a: Array, u: Array) -> tuple[Array, Array]:
    """Return the bounds and the basis that are left where ``a u`` keeps its value.

    u is a member: rounding must not take it out, so no bound stays above its value at u.

    Args:
        rows: (k, n) rows that the inputs meet.
        bounds: (k,) their bounds.
        basis: (n, r) orthonormal free directions.
        a: (s, n) rows to be pinned.
        u: (n,) a member.
    """
    unit, nothing = unit_rows(a, np.zeros(a.shape[0]), ZERO_GRADIENT)
    within, _ = unit_rows(unit @ basis, nothing, DEPENDENT)
    if within.shape[0]:
        basis = basis @ complement(within, DEPENDENT)
    return np.minimum(bounds, rows @ u), basis


@kernel()
def lock(rows: Array, bounds: Array, a: Array, b: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return the rows and bounds with those of ``a u ≥ b`` that u meets, and those it violates.

    Args:
        rows: (k, n) rows that the inputs meet.
        bounds: (k,) their bounds.
        a: (s, n) rows of a stage, of any length.
        b: (s,) their bounds.
        u: (n,) a minimiser of the stage.
    """
    violated = _violated(a, b, u)
    level, bound = level_rows(a[~violated], np.minimum(b, a @ u)[~violated], ZERO_GRADIENT)
    return np.concatenate((rows, level)), np.concatenate((bounds, bound)), a[violated]


@kernel()
def _violated(a: Array, b: Array, u: Array) -> Mask:
    """Return (s,) which rows ``a u ≥ b`` u violates, rounding aside."""
    allowed = MET * (1.0 + np.abs(u).max())
    total = 0.0
    lack, violated = np.empty(b.size), np.empty(b.size, dtype=np.bool_)
    for k in range(b.size):
        square, value = 0.0, 0.0
        for j in range(u.size):
            square += a[k, j] * a[k, j]
            value += a[k, j] * u[j]
        lack[k] = b[k] - value
        violated[k] = lack[k] > allowed * max(np.sqrt(square), ZERO_GRADIENT)
        if violated[k]:
            total += lack[k] * lack[k]
    for k in range(b.size):
        violated[k] = violated[k] and lack[k] > NEGLIGIBLE * np.sqrt(total)
    return violated
