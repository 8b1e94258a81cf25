r"""Margins from what episodes needed: order statistics, round by round, then a search.

With the reserve d an episode came as near as its least h; d − h would have been enough for it. The
new reserve is what all but a small share p of such episodes need. With the k-th largest of n needs
x_k, and s the mean by which the larger ones exceed it,

.. math:: q = x_k + s \ln \frac{k}{n p},

the quantile of a tail that is exponential beyond x_k (I. Weissman, "Estimation of parameters and
large quantiles based on the k largest observations", JASA 73, 1978), within `BEYOND` of the
greatest need. Distances and the speed limit are reserved for apart, each with its own needs.
What goes with a velocity error (k_v, k_p) stays as the plant declares it: it is how the robot
follows, and d is what that leaves.
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

ROUNDS = 4  # how often margins are set before a plant is refused
TAIL = 0.05  # share of the needs from which the tail is read
LEAST_TAIL = 5  # and at least so many
BEYOND = (1.1, 1.25)
"""What is reserved at least and at most, of the greatest need that was seen: a tail that is read
from few episodes exaggerates."""
GENERATIONS, POPULATION = 4, 12  # of a search: attackers of one generation meet the same episode
ELITE = 4  # of a generation, those that the next one is drawn around
STREAM = 43  # sets a search's draws apart from those of the episodes that it runs

Run = Callable[[Uncertainty, Sequence[int], str], list[Seen]]
"""(margins, seeds, title) → what the episodes of these seeds showed."""
Try = Callable[[Uncertainty, Sequence[tuple[int, tuple[float, ...]]], str], list[Seen]]
"""(margins, (seed, parameters) of searched attackers, title) → what they reached."""


class Round(NamedTuple):
    """What one round showed."""

    what: str  # "round", or "search" whose attackers are no independent draws
    margins: dict[str, float]  # that rows reserved
    first_seed: int  # of its episodes
    episodes: int  # how many
    entered: int  # how many of them entered
    least_h: float  # of the strict conditions on the position
    least_speed_h: float | None  # of the speed limit [m/s]; None where there is none


class Calibrated(NamedTuple):
    """Margins, and the rounds in which they were found."""

    margins: Uncertainty
    rounds: tuple[Round, ...]


def calibrate(
    start: Uncertainty,
    run: Run,
    attack: Try | None,
    episodes: int,
    share: float,
    first_seed: int,
    v_max: float = np.inf,
) -> Calibrated:
    """Return margins with which neither fresh episodes nor searched attackers enter.

    The first round may lower what the plant declares; later ones raise it alone.

    Args:
        start: the plant's own margins.
        run: runs episodes.
        attack: runs searched attackers; None searches for none.
        episodes: in each round.
        share: of episodes that may need more, p.
        first_seed: the seeds follow it.
        v_max: the lowest cap on the speed [m/s].

    Raises:
        RefusedError: if the rounds do not do, or the margins leave no room or no speed.
    """
    margins, rounds = start, []
    seed = first_seed
    for number in range(ROUNDS + 1):
        seen = run(margins, range(seed, seed + episodes), f"calibration, round {number}")
        rounds.append(recorded("round", margins, seed, seen))
        seed += episodes
        _check_standing(seen)
        if number == 0:
            _check_stake(seen)
        settled = number > 0 or all(getattr(margins, name) == 0.0 for name in CALIBRATED)
        if settled and not rounds[-1].entered and attack is not None:
            tried = search(margins, attack, seed)
            rounds.append(recorded("search", margins, seed, tried))
            seed += GENERATIONS
            seen = [*seen, *tried]
        wanted = needed(margins, seen, share)
        if settled:
            wanted = {name: max(getattr(margins, name), need) for name, need in wanted.items()}
        margins = margins._replace(**wanted)
        _check_room(margins, seen, v_max)
        if settled and not rounds[-1].entered:
            return Calibrated(margins, tuple(rounds))
    last = rounds[-1]
    raise RefusedError(
        f"calibration: after {ROUNDS} rounds {last.entered} of {last.episodes} episodes of the "
        f"last {last.what} still entered, with {margins.distance:.3g} m "
        f"and {margins.speed:.3g} m/s reserved: the plant does not do what its "
        "model predicts, and no margin makes up for it; look at delay, drag and U"
    )


def needed(margins: Uncertainty, seen: Iterable[Seen], share: float) -> dict[str, float]:
    """Return what all but a share of such episodes need, by constant."""
    outcomes = list(seen)
    needs = {
        "distance": [margins.distance - s.least_h for s in outcomes],
        "speed": [margins.speed - s.least_speed_h for s in outcomes],
    }
    found = {}
    for name in CALIBRATED:
        finite = np.array([need for need in needs[name] if np.isfinite(need)])
        if finite.size:
            found[name] = quantile(finite, share)
    return found


def quantile(needs: ArrayLike, share: float) -> float:
    """Return what all but a share of needs (n,) are below, 0 where none is positive."""
    x = np.sort(finite_array("needs", needs, (None,)))[::-1]
    if x[0] <= 0.0:
        return 0.0
    k = min(len(x) - 1, max(LEAST_TAIL, round(TAIL * len(x))))
    beyond = 0.0 if k < 1 else float((x[:k] - x[k]).mean()) * np.log(k / (len(x) * share))
    return float(np.clip(x[k] + beyond, BEYOND[0] * x[0], BEYOND[1] * x[0]))


def search(margins: Uncertainty, attack: Try, first_seed: int) -> list[Seen]:
    """Search for the attacker that gets deepest; return what all of them reached.

    The cross-entropy method: attackers are drawn from a normal distribution that is fitted to the
    best of the generation before, over six numbers in [0, 1].
    """
    rng, count = np.random.default_rng([STREAM, first_seed]), len(PARAMETERS)
    mean, spread = np.full(count, 0.5), np.full(count, 0.35)
    every: list[Seen] = []
    for generation in range(GENERATIONS):
        drawn = rng.normal(mean, spread, (POPULATION, count)).clip(0.0, 1.0)
        tried = [(first_seed + generation, tuple(numbers.tolist())) for numbers in drawn]
        seen = attack(margins, tried, f"search, generation {generation + 1} of {GENERATIONS}")
        best = np.argsort([min(s.least_h, s.least_speed_h) for s in seen])[:ELITE]
        mean, spread = drawn[best].mean(axis=0), drawn[best].std(axis=0) + 0.05
        every += seen
    return every


def recorded(what: str, margins: Uncertainty, seed: int, seen: Sequence[Seen]) -> Round:
    """Return the record of what episodes showed."""
    speed = min(s.least_speed_h for s in seen)
    return Round(
        what, margins._asdict(), seed, len(seen), sum(s.entered for s in seen),
        min(s.least_h for s in seen), speed if np.isfinite(speed) else None,
    )  # fmt: skip


def _check_standing(seen: Sequence[Seen]) -> None:
    """Refuse a plant that falls, or that the filter's own monitor takes for another one."""
    falls = sum(s.fell for s in seen)
    if 2 * falls > len(seen):
        raise RefusedError(
            f"calibration: the robot fell in {falls} of {len(seen)} episodes: it cannot do what U "
            "requests; look at U and at the cap on the speed"
        )
    alarms = Counter(Reason(s.alarm).name for s in seen if s.alarm)
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
        sum(one.pressed for one in seen),
        float(np.median([one.least_h for one in seen])),
        int(np.median([one.steps for one in seen])),
    )


def _check_stake(seen: Sequence[Seen]) -> None:
    """Refuse episodes of which too few put rank 1 to the test; warn where they may be too few."""
    found, deviation = shown(seen), 0.5 * np.sqrt(len(seen))
    why = vacuous(found, len(seen))
    short = PRESSED * len(seen) - found.pressed
    if not why or (found.half_last >= LASTING and short <= deviation):
        return
    if found.half_last < LASTING or short > 2.0 * deviation:
        raise RefusedError(f"calibration: {why}")
    warn_caller(f"calibration: {why}; else there may be no certificate", SafetyWarning)


def _check_room(margins: Uncertainty, seen: Sequence[Seen], v_max: float) -> None:
    """Refuse margins that reach the starts of most episodes, or take half of the speed."""
    room = float(np.median([s.first_h for s in seen]))
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
    """Return rounds as a certificate's JSON holds them."""
    return tuple(one._asdict() for one in rounds)
