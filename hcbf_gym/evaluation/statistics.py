"""What a count of entries says of the next episode, with how much confidence."""

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
    if not 0.0 < finite_float("confidence", confidence) < 1.0:
        raise InvalidInputError(
            f"confidence: got {confidence!r}, expected a number between 0 and 1"
        )
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


def _check_count(name: str, value: int, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidInputError(f"{name}: got {value!r}, expected an integer >= {least}")
