r"""The calibration of a plant's margins: quantiles of measured needs, then a search for attackers.

Rows reserve a distance d, and an episode comes as near as its least h. A reserve of d − h would
have been enough for it: this is the episode's *need*. The new reserve is exceeded by a share p of
all needs. With x_k the need that k of n needs exceed, and s their mean excess over it,

.. math:: q = x_k + s \ln \frac{k}{n p}

is the quantile of a tail that is exponential beyond x_k (I. Weissman, "Estimation of parameters and
large quantiles based on the k largest observations", JASA 73, 1978). It is clipped to `BEYOND`
times the greatest need. The distance and the speed limit have separate reserves and needs.
The gains on a velocity error (k_v, k_p) stay as the plant declares them. They describe how the
robot follows its input, and d covers the rest.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym._core import Reason
from hcbf_gym.barriers.speed_limit import leaves_speed
from hcbf_gym.certificates.certificate import CALIBRATED
from hcbf_gym.certificates.parts import LASTING, PRESSED, Shown, vacuous
from hcbf_gym.errors import RefusedError, SafetyWarning, finite_array, warn_caller
from hcbf_gym.evaluation.attacks import PARAMETERS
from hcbf_gym.models.plant import Uncertainty
from hcbf_lab.certification.families import Seen

ROUNDS = 4  # with changed margins, after which a plant is refused whose episodes still enter
TAIL_SHARE = 0.05  # of the needs, from which the tail is fitted
MIN_TAIL_SIZE = 5  # the tail has at least so many needs
BEYOND = (1.1, 1.25)
"""The least and the greatest reserve, as multiples of the greatest need: a tail that is fitted to
few episodes exaggerates."""
GENERATIONS, POPULATION = 4, 12  # of the search; one generation's attackers meet the same episode
ELITE = 4  # attackers of a generation, to which the next distribution is fitted
STREAM = 43  # separates the search's random numbers from those of the episodes that it runs

Searched = tuple[int, tuple[float, ...]]
"""A seed, and the parameters of the searched attacker."""
Run = Callable[[Uncertainty, Sequence[int], str], list[Seen]]
"""(margins, seeds, title of the progress bar) → records of the episodes of these seeds."""
Attack = Callable[[Uncertainty, Sequence[Searched], str], list[Seen]]
"""(margins, searched attackers, title of the progress bar) → records of their episodes."""


class Round(NamedTuple):
    """One round of a calibration, as the certificate's JSON holds it."""

    what: str  # "round", or "search", whose attackers are no independent draws
    margins: dict[str, float]  # the margins that rows reserved in this round
    first_seed: int  # of its episodes
    episodes: int  # the number of episodes
    entered: int  # the number of episodes that entered rank 1
    least_h: float  # of the strict conditions on the position
    least_speed_h: float | None  # of the speed limit [m/s]; None without a limit


class Calibrated(NamedTuple):
    """Calibrated margins, and the rounds that led to them."""

    margins: Uncertainty
    rounds: tuple[Round, ...]


def calibrate(
    start: Uncertainty,
    run: Run,
    attack: Attack | None,
    episodes: int,
    share: float,
    first_seed: int,
    v_max: float = np.inf,
) -> Calibrated:
    """Return margins with which neither fresh episodes nor searched attackers enter.

    The first round may lower the margins that the plant declares. Later rounds only raise them.

    Args:
        start: the margins that the plant declares.
        run: runs the episodes of seeds.
        attack: runs searched attackers; None skips the search.
        episodes: the number of episodes in each round.
        share: p, the share of episodes that may need more.
        first_seed: of the first round; the following seeds are used in order.
        v_max: the lowest cap on the speed [m/s].

    Raises:
        RefusedError: if episodes still enter after the last round, or the margins leave no room or
            no speed.
    """
    margins, rounds = start, []
    seed = first_seed
    for number in range(ROUNDS + 1):
        seen = run(margins, range(seed, seed + episodes), f"calibration, round {number}")
        rounds.append(_round_of("round", margins, seed, seen))
        seed += episodes
        _check_plant(seen)
        if number == 0:
            _check_stake(seen)
        may_lower = number == 0 and any(getattr(margins, name) != 0.0 for name in CALIBRATED)
        if not may_lower and not rounds[-1].entered and attack is not None:
            attacked = search(margins, attack, seed)
            rounds.append(_round_of("search", margins, seed, attacked))
            seed += GENERATIONS
            seen = [*seen, *attacked]
        for name, reserve in needed(margins, seen, share).items():
            raised = max(getattr(margins, name), reserve)
            margins = margins._replace(**{name: reserve if may_lower else raised})
        _check_room(margins, seen, v_max)
        if not may_lower and not rounds[-1].entered:
            return Calibrated(margins, tuple(rounds))
    last = rounds[-1]
    raise RefusedError(
        f"calibration: after {ROUNDS} rounds {last.entered} of {last.episodes} episodes of the "
        f"last {last.what} still entered, with {last.margins['distance']:.3g} m "
        f"and {last.margins['speed']:.3g} m/s reserved: the plant does not do what its "
        "model predicts, and no margin makes up for it; look at delay, drag and U"
    )


def needed(margins: Uncertainty, seen: Iterable[Seen], share: float) -> dict[str, float]:
    """Return the reserve of each margin that all but a share of such episodes need.

    A margin is left out if no episode had a condition that it is for.
    """
    episodes = list(seen)
    needs = {
        "distance": [margins.distance - episode.least_h for episode in episodes],
        "speed": [margins.speed - episode.least_speed_h for episode in episodes],
    }
    reserves = {}
    for name in CALIBRATED:
        finite = np.array([need for need in needs[name] if np.isfinite(need)])
        if finite.size:
            reserves[name] = quantile(finite, share)
    return reserves


def quantile(needs: ArrayLike, share: float) -> float:
    """Return the reserve that a share of needs (n,) exceeds; 0 if no need is positive."""
    x = np.sort(finite_array("needs", needs, (None,)))[::-1]
    if x[0] <= 0.0:
        return 0.0
    k = min(len(x) - 1, max(MIN_TAIL_SIZE, round(TAIL_SHARE * len(x))))
    beyond = 0.0 if k < 1 else float((x[:k] - x[k]).mean()) * np.log(k / (len(x) * share))
    return float(np.clip(x[k] + beyond, BEYOND[0] * x[0], BEYOND[1] * x[0]))


def search(margins: Uncertainty, attack: Attack, first_seed: int) -> list[Seen]:
    """Search for the attacker that gets deepest; return the records of all episodes.

    This is the cross-entropy method. A generation's attackers are drawn from a normal distribution
    of their parameters in [0, 1], which is fitted to the `ELITE` of the generation before.
    """
    rng, count = np.random.default_rng([STREAM, first_seed]), len(PARAMETERS)
    mean, spread = np.full(count, 0.5), np.full(count, 0.35)
    all_seen: list[Seen] = []
    for generation in range(GENERATIONS):
        parameters = rng.normal(mean, spread, (POPULATION, count)).clip(0.0, 1.0)
        attackers = [(first_seed + generation, tuple(row.tolist())) for row in parameters]
        seen = attack(margins, attackers, f"search, generation {generation + 1} of {GENERATIONS}")
        depth = [min(episode.least_h, episode.least_speed_h) for episode in seen]
        elite = parameters[np.argsort(depth)[:ELITE]]
        # The 0.05 prevents that the distribution collapses onto one attacker.
        mean, spread = elite.mean(axis=0), elite.std(axis=0) + 0.05
        all_seen += seen
    return all_seen


def _round_of(what: str, margins: Uncertainty, first_seed: int, seen: Sequence[Seen]) -> Round:
    """Return the record of a round from the records of its episodes."""
    least_speed_h = min(episode.least_speed_h for episode in seen)
    return Round(
        what, margins._asdict(), first_seed, episodes=len(seen),
        entered=sum(s.entered for s in seen), least_h=min(s.least_h for s in seen),
        least_speed_h=least_speed_h if np.isfinite(least_speed_h) else None,
    )  # fmt: skip


def _check_plant(seen: Sequence[Seen]) -> None:
    """Refuse a plant that falls, or that differs from the declared one, in most episodes."""
    falls = sum(episode.fell for episode in seen)
    if 2 * falls > len(seen):
        raise RefusedError(
            f"calibration: the robot fell in {falls} of {len(seen)} episodes: it cannot do what U "
            "requests; look at U and at the cap on the speed"
        )
    alarms = Counter(Reason(episode.alarm).name for episode in seen if episode.alarm)
    if 2 * alarms.total() > len(seen):
        named = ", ".join(f"{name} in {count}" for name, count in alarms.most_common())
        raise RefusedError(
            f"calibration: the filter raised alarms in {alarms.total()} of {len(seen)} episodes "
            f"({named}): the plant is not the one that is declared, or another program "
            "changes the filter's input"
        )


def shown(seen: Sequence[Seen]) -> Shown:
    """Return how much episodes put rank 1 to the test."""
    return Shown(
        pressed=sum(episode.pressed for episode in seen),
        half_within=float(np.median([episode.least_h for episode in seen])),
        half_last=int(np.median([episode.steps for episode in seen])),
    )


def _check_stake(seen: Sequence[Seen]) -> None:
    """Refuse episodes that put rank 1 to the test too seldom; warn if that is uncertain yet.

    The certificate requires a share `PRESSED` of fresh episodes. With a chance of about one half
    in each of n episodes, their number has a standard deviation of √n / 2.
    """
    stake, deviation = shown(seen), 0.5 * np.sqrt(len(seen))
    why = vacuous(stake, len(seen))
    missing = PRESSED * len(seen) - stake.pressed
    if not why or (stake.half_last >= LASTING and missing <= deviation):
        return
    if stake.half_last < LASTING or missing > 2.0 * deviation:
        raise RefusedError(f"calibration: {why}")
    warn_caller(f"calibration: {why}; else there may be no certificate", SafetyWarning)


def _check_room(margins: Uncertainty, seen: Sequence[Seen], v_max: float) -> None:
    """Refuse a distance that contains half of the starts, and a margin that leaves no speed."""
    room = float(np.median([episode.first_h for episode in seen]))
    if margins.distance >= room:
        raise RefusedError(
            f"calibration: rows would reserve {margins.distance:.3g} m, and half of the episodes "
            f"start within {room:.3g} m of a strict region: the margin leaves no room"
        )
    if not leaves_speed(v_max, margins.speed):
        raise RefusedError(
            f"calibration: the row of the speed limit would reserve {margins.speed:.3g} m/s of "
            f"{v_max:g} m/s: the margin leaves no speed; raise v_max, or reduce U"
        )


def plain(rounds: Iterable[Round]) -> tuple[Mapping[str, Any], ...]:
    """Return rounds as dicts, for the certificate's JSON."""
    return tuple(calibration_round._asdict() for calibration_round in rounds)
