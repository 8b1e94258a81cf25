r"""A bound on the chance of entering rank 1 that may be inspected after every episode.

Of n episodes k have entered. With :math:`q = ε/5`,

.. math:: e_n(ε) = (q/ε)^k \left(\frac{1 − q}{1 − ε}\right)^{n − k}

is the wealth from a stake of 1 in a bet on the chance q at the odds of ε. Where each episode enters
with a chance of at least ε, whatever came before, the wealth is a supermartingale, so that it ever
reaches 1/β with a probability of at most β (Ville). As e grows with ε, the least ε at which it has
reached 1/β bounds the chance at every n at once. One may inspect it, stop and continue.

>>> [episodes_needed(1e-2, entered, 1e-3) for entered in (0, 1, 2, 5)]
[859, 1060, 1261, 1864]

Source: J. Ville, "Étude critique de la notion de collectif" (1939); A. Wald, "Sequential tests of
statistical hypotheses", Annals of Mathematical Statistics 16 (1945).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

BET = 5.0  # ε/q. The wager is best if episodes enter so many times less often than the bound
NEVER = 2.0  # above ε over this, e falls on average, and no number of episodes certifies ε
DOUBT = 1e-3  # bounds the probability of calling a run of a chance up to ε / `NEVER` hopeless
LARGEST_LOG_E = 700.0  # ln e above which e is cut off: doubles overflow at 709


def log_e(entered: int, episodes: int, chance: float, rival: float) -> float:
    """Return ln e of a wager on a rival chance of entering, k of n episodes having entered."""
    stays = math.log1p(-rival) - math.log1p(-chance)
    return entered * math.log(rival / chance) + (episodes - entered) * stays


def e_value(entered: int, episodes: int, bound: float) -> float:
    """Return e_n(ε) with k of n episodes entered and 0 < ε < 1."""
    return math.exp(min(log_e(entered, episodes, bound, bound / BET), LARGEST_LOG_E))


def running_bound(entered: int, episodes: int, beta: float) -> float:
    """Return the least ε with e_n(ε) ≥ 1/β, k of n episodes having entered; 1 for none."""
    from scipy.optimize import brentq

    def surplus(bound: float) -> float:
        """Return ln e − ln(1/β), which grows with the bound."""
        return log_e(entered, episodes, bound, bound / BET) + math.log(beta)

    low, high = 1e-12, 1.0 - 1e-12
    if surplus(high) < 0.0:
        return 1.0
    root: Any = brentq(surplus, low, high, xtol=1e-13, rtol=np.float64(1e-12))
    return float(root)


def episodes_needed(bound: float, entered: int, beta: float) -> int:
    """Return the least number of episodes that certify ε at β, if k of them have entered."""
    lost = entered * math.log(BET)
    stays = math.log1p(-bound / BET) - math.log1p(-bound)
    return entered + math.ceil((lost - math.log(beta)) / stays)


def any_weighting(counts: Iterable[tuple[int, int]], beta: float) -> float:
    """Return a bound for every weighting of m families: the greatest of theirs, each at β/m.

    Args:
        counts: (entered, episodes) of each family.
        beta: β.
    """
    families = list(counts)
    return max((running_bound(k, n, beta / len(families)) for k, n in families), default=1.0)


@dataclass
class Tally:
    """Counts the episodes of a run in their order, and decides when it may end.

    Args:
        bound: ε.
        beta: β, the probability with which the bound may be wrong.
        entered: k, so far.
        episodes: n, so far.
    """

    bound: float
    beta: float
    entered: int = 0
    episodes: int = 0

    def add(self, entered: bool) -> None:
        """Count one more episode."""
        self.episodes += 1
        self.entered += entered

    @property
    def certified(self) -> bool:
        """Whether e has reached 1/β, so that ε is certified."""
        gained = log_e(self.entered, self.episodes, self.bound, self.bound / BET)
        return gained >= -math.log(self.beta)

    @property
    def hopeless(self) -> bool:
        """Whether the chance is above ε / `NEVER`, by a wager on ε that has reached 1 / `DOUBT`."""
        gained = log_e(self.entered, self.episodes, self.bound / NEVER, self.bound)
        return gained >= -math.log(DOUBT)
