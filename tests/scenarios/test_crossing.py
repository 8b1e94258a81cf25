"""Traffic that is faster than the robot: its lanes, and intentions that change unannounced."""

import json

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import cli, scenarios
from hcbf_gym.errors import HcbfError, InvalidInputError
from hcbf_gym.evaluation.rollouts import Case
from hcbf_gym.scenarios import crossing, hall
from hcbf_gym.scenarios.scene import X, Y

ID, SCENE = "HCBF-Regions-v0", "random-crossing"
EPISODE = 20.0  # [s]
HIDDEN = {"scenario": SCENE, "intentions": "hidden"}


def drawn(seed):
    return scenarios.family_of(SCENE).draw_scenes([np.random.default_rng(seed)]).one(0)


def lanes(array):
    return array[hall.WALLS :].reshape(len(crossing.LANES), crossing.DISCS, *array.shape[1:])


def test_three_lanes_of_one_rank_and_speed_each_are_faster_than_the_robot():
    ranks, sides = set(), set()
    for seed in range(200):
        scene = drawn(seed)
        speeds, shapes = lanes(scene.velocities)[..., 1], lanes(scene.shapes)
        assert (np.ptp(speeds, axis=1) == 0.0).all()
        assert not scene.velocities[:, 0].any()
        assert (np.abs(speeds) >= crossing.SPEED[0]).all()
        assert (np.abs(speeds) <= crossing.SPEED[1]).all()
        assert (shapes[..., X] == np.array(crossing.LANES)[:, None]).all()
        assert (np.ptp(lanes(scene.ranks), axis=1) == 0).all()
        ranks.add(tuple(lanes(scene.ranks)[:, 0].tolist()))
        sides |= set(np.sign(speeds[:, 0]).tolist())
        gaps = np.abs(np.diff(shapes[..., Y], axis=1))
        assert gaps.min() >= crossing.GAP[0] - 1e-9
        assert gaps.max() <= crossing.GAP[1] + 1e-9
        # at the end of an episode, discs are still to come
        left = np.sign(speeds[:, -1]) * shapes[:, -1, Y] + EPISODE * np.abs(speeds[:, -1])
        assert (left < crossing.HALF_WIDTH).all()
    assert ranks == set(crossing.RANKS)
    assert sides == {-1.0, 1.0}


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_batch_is_the_single_ones_bit_for_bit(mode):
    n, options = 6, HIDDEN | {"max_episode_steps": 40}
    batch = gym.make_vec(ID, num_envs=n, autoreset_mode=mode, **options)
    alone = [gym.make(ID, **options) for _ in range(n)]
    observation, _ = batch.reset(seed=3)
    for i, env in enumerate(alone):
        assert env.reset(seed=3 + i)[0].tobytes() == observation[i].tobytes()
    rng, done = np.random.default_rng(0), np.zeros(n, dtype=bool)
    for _ in range(130):
        u = rng.uniform(-5.0, 5.0, (n, 2)).astype(np.float32)
        observation, _, terminated, truncated, infos = batch.step(u)
        over = terminated | truncated
        for i, env in enumerate(alone):
            if mode == "NextStep" and done[i]:
                expected, info = env.reset()
            else:
                expected, *_, info = env.step(u[i])
            if mode == "SameStep" and over[i]:
                expected, info = env.reset()
            assert observation[i].tobytes() == expected.tobytes()
            assert infos["min_h"][i].tobytes() == info["min_h"].tobytes()
        done = over


def test_hidden_speeds_change_and_every_disc_continues_from_where_it_is():
    env, known = gym.make(ID, **HIDDEN).unwrapped, gym.make(ID, scenario=SCENE).unwrapped
    observation, _ = env.reset(seed=1)
    assert observation.tobytes() == known.reset(seed=1)[0].tobytes()
    u, changes = np.zeros(2, dtype=np.float32), 0
    before = [disc.velocity for disc in env.scenario.barriers[hall.WALLS :]]
    for _ in range(600):
        h = env.barrier_set.values(env.rom_state[None], np.array([env.time]))[0]
        env.step(u)
        after = env.barrier_set.values(env.rom_state[None], np.array([env.time]))[0]
        # no disc is farther than its greatest speed allows
        assert np.abs(after - h).max() <= 0.02 * crossing.SPEED[1] + 1e-9
        velocities = [disc.velocity for disc in env.scenario.barriers[hall.WALLS :]]
        changes += velocities != before
        before = velocities
    assert changes > 5
    speeds = np.abs(before)[:, 1]
    assert crossing.HIDDEN[0] <= speeds.min()
    assert speeds.max() <= crossing.HIDDEN[1]
    env.reset(seed=1, options={"start": (0.0, 0.5)})  # of a scene that is given, they are known
    given = env.scenario
    for _ in range(300):
        env.step(u)
    assert env.scenario is given


def test_intentions_are_refused_where_a_family_has_none():
    for given in ({"scenario": "random-moving"}, {"scenario": "trolley"}, {}):
        with pytest.raises(InvalidInputError, match="redraw="):
            gym.make(ID, intentions="hidden", **given)
    with pytest.raises(HcbfError, match="intentions"):
        gym.make(ID, scenario=SCENE, intentions="secret")
    with pytest.raises(InvalidInputError, match="redraw"):
        scenarios.register("unclear", crossing.draw, shapes=38, redraw=3)
    made = gym.make(ID, **HIDDEN)
    assert gym.envs.registration.EnvSpec.from_json(made.spec.to_json()).kwargs == HIDDEN
    declared = made.unwrapped.declared
    assert declared["intentions"] == "hidden"
    assert "intentions" not in gym.make(ID, scenario=SCENE).unwrapped.declared


def test_users_families_redraw_too_and_walls_never_move():
    def everything(generator, velocities):
        velocities[:] = generator.uniform(-1.0, 1.0, velocities.shape)

    def nothing(generator, velocities):
        velocities[:] = np.nan

    for name, redraw in (("restless", everything), ("lost", nothing)):
        scenarios.register(name, crossing.draw, shapes=38, redraw=redraw)
    env = gym.make(ID, scenario="restless", intentions="hidden").unwrapped
    env.reset(seed=0)
    walls = env.scenario.barriers[: hall.WALLS]
    for _ in range(20):
        env.step(np.zeros(2, dtype=np.float32))
    assert env.scenario.barriers[: hall.WALLS] == walls
    assert len({disc.velocity for disc in env.scenario.barriers[hall.WALLS :]}) == 36
    lost = gym.make(ID, scenario="lost", intentions="hidden")
    lost.reset(seed=0)
    with pytest.raises(InvalidInputError, match="finite velocities"):
        lost.step(np.zeros(2, dtype=np.float32))


def test_pd_arrives_and_evaluate_and_certify_run_on_it(tmp_path):
    case = Case(ID, SCENE, "pd", "lex-cbf-qp", env_options={"intentions": "hidden"})
    assert case.run(0).summary()["reached"]
    given = ["--scenario", SCENE, "--intentions", "hidden", "--program", "lex-cbf-qp"]
    cli.main(["evaluate", "--env", ID, *given, "--steps", "30", "--output", str(tmp_path / "e")])
    assert json.loads((tmp_path / "e/summary.json").read_text())["episodes"]
    budget = ["--bound", "0.9", "--confidence", "0.9", "--calibration", "0", "--steps", "50"]
    given = ["--scenes", SCENE, "--policies", "pd", "--output", str(tmp_path / "c")]
    cli.main(["certify", "regions", *given, *budget, "--workers", "1"])
    written = json.loads((tmp_path / "c/regions.json").read_text())
    assert written["plant"]["scene"] == {"any of": [SCENE]}
