import numpy as np
import pytest

from hcbf_gym.envs.a1_physics import BASE, A1Physics
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.robots.reader import read_robot

WALK = 1500  # ticks


@pytest.fixture(scope="session")
def legs():
    return RobotModel(read_robot()).legs


@pytest.fixture(scope="session")
def walk():
    """(WALK + 1, 41) true states of an A1 that changes its velocity every .4 s."""
    physics, controller = A1Physics(), LocomotionController()
    physics.reset(np.zeros(2), 0.3, np.random.default_rng(0))
    controller.reset(physics.state())
    rng = np.random.default_rng(1)
    truth = [physics.truth]
    for k in range(WALK):
        if k % 200 == 0:
            wanted = rng.uniform(-0.8, 0.8, 2)
        u = np.clip(4.0 * (wanted - physics.truth[BASE[2:]]), -3.0, 3.0)
        physics.step(controller.step(physics.state(), u))
        truth.append(physics.truth)
    assert not physics.fallen
    return np.array(truth)
