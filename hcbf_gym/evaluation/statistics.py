"""Bounds and intervals of the chances and means behind counts and means of episodes."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta, binomtest, t

from hcbf_gym.errors import InvalidInputError, count, finite_float

CONFIDENCE = 0.999  # of the bounds in tables
BOUNDED = f"≤ at {CONFIDENCE:.1%}"  # in the name of a column or line with such bounds


def upper_bound(entered: int, episodes: int, confidence: float = CONFIDENCE) -> float:
    r"""Return an upper bound of the chance that an episode enters a strict region.

    .. math::
        P(\\text{enter}) ≤ \\text{BetaInv}(c; k + 1, n − k)

    holds with confidence c, whatever the chance is, if the n episodes were drawn independently
    from one distribution and n was not chosen after a look at them. Episodes of a searched attack
    are no independent draws, so that no bound follows from them.

    Args:
        entered: k, the number of episodes that entered.
        episodes: n, the number of all episodes.
        confidence: c, between 0 and 1.

    Raises:
        InvalidInputError: if the counts are no integers with 0 ≤ k ≤ n and n ≥ 1, or the confidence
            is not between 0 and 1.

    Source: C. J. Clopper and E. S. Pearson, Biometrika 26 (1934).
    """
    count("episodes", episodes)
    count("entered", entered, minimum=0)
    if entered > episodes:
        raise InvalidInputError(f"entered: got {entered} of {episodes} episodes, expected no more")
    if not 0.0 < finite_float("confidence", confidence) < 1.0:
        raise InvalidInputError(
            f"confidence: got {confidence!r}, expected a number between 0 and 1"
        )
    if entered == episodes:
        return 1.0
    return float(beta.ppf(confidence, entered + 1, episodes - entered))


INTERVAL = 0.95  # the confidence of the intervals of shares and means in tables

Interval = list[float] | None  # [low, high]; None if there are too few values for one


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean; None if there are no values, or if one of them is not known."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known and len(known) == len(values) else None


def share_interval(outcomes: Sequence[bool | None]) -> Interval:
    """Return the exact interval of the chance of an outcome; None if one is not known.

    Examples:
        >>> [round(end, 3) for end in share_interval([True] * 19 + [False])]
        [0.751, 0.999]
    """
    if not outcomes or None in outcomes:
        return None
    return _exact_interval(sum(map(bool, outcomes)), len(outcomes))


def _exact_interval(successes: int, trials: int) -> list[float]:
    """Return the interval [low, high] of a chance by Clopper and Pearson."""
    low, high = binomtest(successes, trials).proportion_ci(INTERVAL, "exact")
    return [float(low), float(high)]


def shown_share(share: float, n: int) -> str:
    """Return a share of n outcomes with its exact interval, in percent, for tables.

    Examples:
        >>> shown_share(0.76, 200)
        '76.0 [69.5, 81.7]'
    """
    low, high = _exact_interval(round(share * n), n)
    return f"{100.0 * share:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def mean_interval(values: Sequence[float]) -> Interval:
    """Return Student's interval of a mean; None for fewer than two values.

    Examples:
        >>> [round(end, 3) for end in mean_interval([1.0, 2.0, 3.0])]
        [-0.484, 4.484]
    """
    n = len(values)
    if n < 2:
        return None
    standard_error = np.std(values, ddof=1) / np.sqrt(n)
    half_width = float(t.ppf(0.5 + 0.5 * INTERVAL, n - 1) * standard_error)
    center = float(np.mean(values))
    return [center - half_width, center + half_width]


def counted(entered: int, episodes: int) -> str:
    """Return a count with the bound of the chance, for tables.

    >>> counted(0, 1400)
    '0 (≤ 0.49%)'
    """
    return f"{entered} ({at_most(entered, episodes)})"


def at_most(entered: int, episodes: int) -> str:
    """Return the bound of the chance as text, for tables."""
    return f"≤ {upper_bound(entered, episodes):.2%}"
