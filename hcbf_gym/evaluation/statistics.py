"""What a count of entries says of the next episode, with how much confidence."""

import bisect

import numpy as np
from scipy.stats import beta

from hcbf_gym.errors import InvalidInputError, finite_float

CONFIDENCE = 0.999
"""Of the bounds that tables give."""
BOUNDED = f"≤ at {CONFIDENCE:.1%}"
"""What a column's name says of the bounds in it."""


def upper_bound(entered: int, episodes: int, confidence: float = CONFIDENCE) -> float:
    r"""Return the greatest chance of entering that is in accord with a count.

    .. math::
        P(\text{enter}) ≤ \text{BetaInv}(c; k + 1, n − k)

    holds with confidence c, whatever the chance is, where the n episodes were drawn independently
    from one distribution and n was not chosen after a look at them. Searched attackers find
    failures; they are no independent draws, and no bound follows from them.

    Args:
        entered: k, the episodes that entered.
        episodes: n, all episodes.
        confidence: c, between 0 and 1.

    Returns:
        The bound; 1 where all entered.

    Raises:
        InvalidInputError: if the counts are no integers with 0 ≤ k ≤ n and n ≥ 1, or the confidence
            does not lie between 0 and 1.

    Source: C. J. Clopper and E. S. Pearson, "The use of confidence or fiducial limits illustrated
    in the case of the binomial", Biometrika 26 (1934).
    """
    _check_count("episodes", episodes, 1)
    _check_count("entered", entered, 0)
    if entered > episodes:
        raise InvalidInputError(f"entered: got {entered} of {episodes} episodes, expected no more")
    _check_share("confidence", confidence)
    if entered == episodes:
        return 1.0
    return float(beta.ppf(confidence, entered + 1, episodes - entered))


def counted(entered: int, episodes: int) -> str:
    """Return a count with its bound, as tables show them.

    >>> counted(0, 1400)
    '0 (≤ 0.49%)'
    """
    return f"{entered} ({at_most(entered, episodes)})"


def at_most(entered: int, episodes: int) -> str:
    """Return the bound as tables show it beside a share."""
    return f"≤ {upper_bound(entered, episodes):.2%}"


def episodes_needed(bound: float, allowed: int = 0, confidence: float = CONFIDENCE) -> int:
    """Return the least number of episodes of which `allowed` may enter under a bound.

    Args:
        bound: the chance of entering that is to be certified, between 0 and 1.
        allowed: how many may enter.
        confidence: of the bound, between 0 and 1.

    Raises:
        InvalidInputError: if a number does not make sense.

    >>> episodes_needed(1e-2), episodes_needed(1e-3), episodes_needed(1e-3, 5)
    (688, 6905, 16450)
    """
    _check_share("bound", bound)
    _check_count("allowed", allowed, 0)

    def certifies(episodes: int) -> bool:
        return upper_bound(allowed, episodes, confidence) <= bound

    most = allowed + 1
    while not certifies(most):
        most *= 2
    return bisect.bisect_left(range(most), True, lo=allowed + 1, key=certifies)


def _check_count(name: str, value: int, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidInputError(f"{name}: got {value!r}, expected an integer >= {least}")


def _check_share(name: str, value: float) -> None:
    if not 0.0 < finite_float(name, value) < 1.0:
        raise InvalidInputError(f"{name}: got {value!r}, expected a number between 0 and 1")
