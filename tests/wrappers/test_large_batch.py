"""Each plant of a batch, however large, is filtered as it would be alone."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter


@pytest.mark.parametrize("program", ["r-cbf-qp", "h-cbf-qp", "eh-cbf-qp"])
def test_each_plant_of_a_large_batch_has_its_own_weights(program):
    count = 70
    rng = np.random.default_rng(3)
    gamma0 = 10.0 ** rng.uniform(-1.0, 2.0, (count, 2))
    delta_gamma = rng.uniform(0.0, 2.0, (count, 1))
    scene = {
        "name": "conflict",
        "barriers": [
            {"kind": "disc", "name": "strict", "priority": 1, "center": [0.9, 0.0], "radius": 0.5},
            {"kind": "disc", "name": "left", "priority": 2, "center": [0.4, 0.8], "radius": 0.6},
            {"kind": "disc", "name": "right", "priority": 3, "center": [0.4, -0.8], "radius": 0.6},
        ],
        "reference": {"kind": "point", "goal": [3.0, 0.0]},
        "start": [0.0, 0.0],
    }
    envs = gym.make_vec("HCBF-Regions-v0", num_envs=count, scenario=scene)
    envs = VectorSafetyFilter(envs, program, gamma0=gamma0, delta_gamma=delta_gamma)
    envs.reset(seed=0)
    actions = rng.uniform(1.0, 4.0, (40, 1, 2)) * np.array([1.0, 0.2])
    answers = np.array(
        [
            envs.step(np.repeat(u, count, axis=0).astype(np.float32))[4]["safety_filter"]["u_safe"]
            for u in actions
        ]
    )
    assert len(np.unique(answers[-1].round(9), axis=0)) > count // 2  # the weights matter
    for i in (0, 31, 32, 45, 63, 64, 69):
        options = {"gamma0": gamma0[i], "delta_gamma": delta_gamma[i, 0]}
        env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario=scene), program, **options)
        env.reset(seed=0)
        alone = [env.step(u[0].astype(np.float32))[4]["safety_filter"]["u_safe"] for u in actions]
        np.testing.assert_allclose(answers[:, i], alone, rtol=0.0, atol=1e-9)
