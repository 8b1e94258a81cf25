"""A plant that does half or twice of its input, nothing or the contrary raises an alarm."""

import numpy as np
import pytest

from hcbf_gym import wrappers
from hcbf_gym.barriers import Disc
from hcbf_gym.models.plant import FIRST_ALARM, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator, SingleIntegrator
from tests.worlds import World

PERIOD = 0.05
FAR = Disc("far", 1, center=(50.0, 0.0), radius=1.0)


class Scaled(World):
    """The model itself under a share of its input."""

    share = 1.0

    def advance(self, u):
        return super().advance(self.share * u)


@pytest.mark.parametrize("share", [0.0, 0.5, 2.0, -1.0, 1.0])
@pytest.mark.parametrize(
    "model", [DoubleIntegrator(), DoubleIntegrator(drag=0.5), SingleIntegrator()], ids=repr
)
@pytest.mark.filterwarnings("ignore:safety filter")
def test_a_share_of_the_input_is_an_alarm_within_a_second(model, share):
    plant = Plant(model, [FAR], lambda env, x, info: x, period=PERIOD)
    world = Scaled(model, PERIOD, 1.0)
    world.share = share
    env = wrappers.SafetyFilter(world, plant=plant)
    env.reset(seed=0)
    rng, alarmed = np.random.default_rng(0), False
    for _ in range(20):
        *_, info = env.step(rng.uniform(0.3, 1.0, 2))
        alarmed |= bool(info["safety_filter"]["reason"] >= FIRST_ALARM)
    assert alarmed == (share != 1.0)
