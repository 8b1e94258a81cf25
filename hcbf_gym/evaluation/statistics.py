"""What counts and means of episodes say of the next one, with how much confidence."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta, binomtest, t

from hcbf_gym.errors import InvalidInputError, finite_float

CONFIDENCE = 0.999
"""Of the bounds that tables give."""
BOUNDED = f"≤ at {CONFIDENCE:.1%}"
"""In the name of a column with such bounds."""


def upper_bound(entered: int, episodes: int, confidence: float = CONFIDENCE) -> float:
    r"""Return the greatest chance of entering that is in accord with a count.

    .. math::
        P(\\text{enter}) ≤ \\text{BetaInv}(c; k + 1, n − k)

    holds with confidence c, whatever the chance is, where the n episodes were drawn independently
    from one distribution and n was not chosen after a look at them. Searched attackers find
    failures; they are no independent draws, and no bound follows from them.

    Args:
        entered: k, the episodes that entered.
        episodes: n, all episodes.
        confidence: c, between 0 and 1.

    Raises:
        InvalidInputError: if the counts are no integers with 0 ≤ k ≤ n and n ≥ 1, or the confidence
            is not between 0 and 1.

    Source: C. J. Clopper and E. S. Pearson, Biometrika 26 (1934).
    """
    _check_count("episodes", episodes, 1)
    _check_count("entered", entered, 0)
    if entered > episodes:
        raise InvalidInputError(f"entered: got {entered} of {episodes} episodes, expected no more")
    if not 0.0 < finite_float("confidence", confidence) < 1.0:
        raise InvalidInputError(
            f"confidence: got {confidence!r}, expected a number between 0 and 1"
        )
    if entered == episodes:
        return 1.0
    return float(beta.ppf(confidence, entered + 1, episodes - entered))


INTERVAL = 0.95
"""Confidence of the intervals that tables give of shares and means."""

Interval = list[float] | None
"""[low, high]; None where too little was seen for one."""


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean; None of nothing, and where one is not known."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known and len(known) == len(values) else None


def share_interval(outcomes: Sequence[bool | None]) -> Interval:
    """Return the exact interval (Clopper and Pearson) of the chance of an outcome.

    >>> [round(end, 3) for end in share_interval([True] * 19 + [False])]
    [0.751, 0.999]
    """
    if not outcomes or None in outcomes:
        return None
    found = binomtest(sum(map(bool, outcomes)), len(outcomes)).proportion_ci(INTERVAL, "exact")
    return [float(found.low), float(found.high)]


def shown_share(share: float, n: int) -> str:
    """Return a share of n outcomes with its interval in percent, as tables show it.

    Examples:
        >>> shown_share(0.76, 200)
        '76.0 [69.5, 81.7]'
    """
    count = round(share * n)
    low, high = binomtest(count, n).proportion_ci(INTERVAL, "exact")
    return f"{100.0 * share:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def mean_interval(values: Sequence[float]) -> Interval:
    """Return Student's interval of a mean; None of fewer than two values.

    >>> [round(end, 3) for end in mean_interval([1.0, 2.0, 3.0])]
    [-0.484, 4.484]
    """
    n = len(values)
    if n < 2:
        return None
    half = float(t.ppf(0.5 + 0.5 * INTERVAL, n - 1) * np.std(values, ddof=1) / np.sqrt(n))
    middle = float(np.mean(values))
    return [middle - half, middle + half]


def counted(entered: int, episodes: int) -> str:
    """Return a count with its bound, as tables show them.

    >>> counted(0, 1400)
    '0 (≤ 0.49%)'
    """
    return f"{entered} ({at_most(entered, episodes)})"


def at_most(entered: int, episodes: int) -> str:
    """Return the bound as tables show it beside a share."""
    return f"≤ {upper_bound(entered, episodes):.2%}"


def _check_count(name: str, value: int, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidInputError(f"{name}: got {value!r}, expected an integer >= {least}")
