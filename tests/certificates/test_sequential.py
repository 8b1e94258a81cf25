"""The running bound is wrong as rarely as it promises, and good plants pass."""

import numpy as np
import pytest

from hcbf_gym.certificates import sequential
from hcbf_gym.certificates.sequential import Tally, running_bound

BOUND, BETA = 1e-2, 1e-3


def played(chance, runs, most, seed=0):
    """Return of each run after how many episodes it was certified; 0 where it was given up."""
    rng, ends = np.random.default_rng(seed), []
    for _ in range(runs):
        tally = Tally(BOUND, BETA)
        for entered in rng.random(most) < chance:
            tally.add(bool(entered))
            if tally.certified or tally.hopeless:
                break
        ends.append(tally.episodes if tally.certified else 0)
    return np.array(ends)


def test_so_many_episodes_certify_one_per_cent():
    needed = [sequential.episodes_needed(BOUND, k, BETA) for k in (0, 1, 2, 5)]
    assert needed == [859, 1060, 1261, 1864]
    for k, n in zip((0, 1, 2, 5), needed, strict=True):
        assert Tally(BOUND, BETA, k, n).certified
        assert not Tally(BOUND, BETA, k, n - 1).certified


@pytest.mark.parametrize(("k", "n"), [(0, 1), (0, 859), (3, 400), (40, 50), (1, 100_000)])
def test_the_running_bound_is_the_least_at_which_the_wager_has_won(k, n):
    bound = running_bound(k, n, BETA)
    assert sequential.e_value(k, n, bound * (1.0 + 1e-6)) >= 1.0 / BETA
    assert sequential.e_value(k, n, bound * (1.0 - 1e-6)) < 1.0 / BETA


def test_nothing_is_known_of_no_episodes_or_where_all_entered():
    assert running_bound(0, 0, BETA) == running_bound(7, 7, BETA) == 1.0


def test_every_weighting_costs_more_than_one_and_is_no_better_than_the_worst_family():
    counts = [(0, 900), (1, 900), (0, 300)]
    bound = sequential.any_weighting(counts, BETA)
    assert bound == running_bound(0, 300, BETA / 3) > max(running_bound(*c, BETA) for c in counts)


def test_a_chance_of_a_tenth_or_a_fifth_is_always_certified():
    for chance, mean in ((0.1, 1074.0), (0.2, None)):
        ends = played(chance * BOUND, 150, 20_000)
        assert (ends > 0).all()
        assert mean is None or ends.mean() == pytest.approx(mean, rel=0.05)


def test_the_chance_itself_hardly_ever_passes_and_is_given_up():
    ends = played(BOUND, 150, 30_000)
    assert (ends > 0).sum() <= 2
