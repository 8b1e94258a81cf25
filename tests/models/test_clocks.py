"""One law of ages."""

import math

import numpy as np
import pytest

from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import AHEAD


@pytest.mark.parametrize("oldest", [0.0, 0.1, 60.0, math.inf])
def test_an_age_is_accepted_from_a_tenth_ahead_to_the_oldest_and_else_named(oldest):
    ages = np.array([-10.0, -1.01 * AHEAD, -AHEAD, 0.0, oldest, 1.01 * oldest + 1e-3])
    ages = np.append(ages, [math.nan, math.inf, -math.inf])
    accepted = clocks.is_accepted(ages, oldest)
    for age, here in zip(ages.tolist(), accepted.tolist(), strict=True):
        assert here == bool(clocks.is_accepted(age, oldest))
        assert here == (math.isfinite(age) and -AHEAD <= age <= oldest)
        if not here and math.isfinite(age):
            assert ("ahead" if age < 0.0 else "old") in clocks.refusal(age, oldest)
