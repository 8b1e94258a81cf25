import numpy as np
import pytest
from scipy.stats import binom

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.statistics import upper_bound


@pytest.mark.parametrize(("entered", "episodes"), [(0, 1), (0, 688), (3, 40), (5, 16450), (39, 40)])
def test_at_the_bound_so_few_entries_are_as_rare_as_the_doubt(entered, episodes):
    bound = upper_bound(entered, episodes, 0.99)
    assert binom.cdf(entered, episodes, bound) == pytest.approx(0.01, rel=1e-6)


def test_the_bound_covers_the_true_chance_with_its_confidence():
    rng = np.random.default_rng(0)
    chance, episodes = 0.02, 200
    counts = rng.binomial(episodes, chance, 4000)
    covered = np.mean([upper_bound(int(k), episodes, 0.95) >= chance for k in counts])
    assert covered >= 0.94


def test_nothing_is_bounded_where_all_enter():
    assert upper_bound(7, 7) == 1.0


@pytest.mark.parametrize(
    "refused",
    [
        lambda: upper_bound(0, 0),
        lambda: upper_bound(-1, 5),
        lambda: upper_bound(6, 5),
        lambda: upper_bound(True, 5),
        lambda: upper_bound(0.0, 5),  # type: ignore[arg-type]
        lambda: upper_bound(0, 5, 1.0),
        lambda: upper_bound(0, 5, float("nan")),
    ],
)
def test_invalid_counts_and_shares_are_refused(refused):
    with pytest.raises(InvalidInputError):
        refused()
