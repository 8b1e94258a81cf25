"""N plants of any model in one filter: the reports of N single filters, and faults of one alone."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import hcbf_gym
from hcbf_gym import Estimate, models, wrappers
from hcbf_gym.barriers import Barrier, BarrierSet, Disc, HalfPlane, Jet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from tests.pairs import pairwise
from tests.worlds import boat

T, N = 0.05, 5
WALL = HalfPlane("wall", 2, normal=(0.0, 1.0), offset=-1.0)
SHARED = [Disc("strict", 1, center=(1.0, 0.2), radius=0.4), WALL]
OWN = [[Disc("strict", 1, center=(1.0 + 0.1 * i, 0.2), radius=0.4), WALL] for i in range(N)]


MODELS = {
    "unicycle": models.Unicycle(),
    "bicycle": models.KinematicBicycle(),
    "velocities": models.SingleIntegrator(),
    "drag": models.DoubleIntegrator(drag=0.5),
    "own": boat(),
    "three inputs": models.DoubleIntegrator(3),
}


def starts(model):
    rng = np.random.default_rng(0)
    return rng.uniform(-0.4, 0.2, (N, model.n)) * np.r_[1.0, 1.0, np.full(model.n - 2, 0.5)]


class Many(VectorEnv):
    """N plants that are their model; `lies` changes their samples."""

    def __init__(self, model, scenes, lies=None):
        self.num_envs, self.model, self.lies = N, model, lies or (lambda x, k: x)
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.single_action_space = gym.spaces.Box(-1.5, 1.5, (model.n_u,), np.float64)
        self.action_space = batch_space(self.single_action_space, N)
        self.plant = hcbf_gym.Plant(
            model,
            (lambda *_: scenes()) if callable(scenes) else scenes,
            lambda env, *_: env.lies(env.x.copy(), env.steps),
            period=T,
        )

    def reset(self, *, seed=None, options=None):
        self.x, self.steps = starts(self.model), 0
        return self.x, {}

    def step(self, actions):
        self.steps += 1
        for i in range(N):
            self.x[i] = self.model.step(self.x[i], np.array(actions[i]), T)
        never = np.zeros(N, dtype=np.bool_)
        return self.x, np.zeros(N), never, never, {}


class One(gym.Env):
    """One of them."""

    def __init__(self, model, scene, i, lies=None):
        self.model, self.i, self.lies = model, i, lies or (lambda x, k: x)
        self.action_space = gym.spaces.Box(-1.5, 1.5, (model.n_u,), np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (model.n,), np.float64)
        self.plant = hcbf_gym.Plant(model, scene, lambda env, *_: env.answers(), period=T)

    def answers(self):
        all_of_them = np.tile(self.x, (N, 1))
        reported = self.lies(all_of_them, self.steps)
        return reported[self.i] if isinstance(reported, np.ndarray) else reported

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.steps = starts(self.model)[self.i], 0
        return self.x.copy(), {}

    def step(self, action):
        self.steps += 1
        self.x = self.model.step(self.x, np.array(action), T)
        return self.x.copy(), 0.0, False, False, {}


def inputs(model, count=60):
    rng = np.random.default_rng(1)
    return np.repeat(rng.uniform(-1.5, 1.5, (count // 10, N, model.n_u)), 10, axis=0)


def batch_of(model, scenes, lies=None, **options):
    env = Many(model, scenes, lies)
    return wrappers.VectorSafetyFilter(env, **options)


@pytest.mark.parametrize(
    ("name", "program", "listed"),
    pairwise(MODELS, ("lex-cbf-qp", "r-cbf-qp"), ("one list", "a list each")),
)
@pytest.mark.filterwarnings("ignore")
def test_a_batch_reports_what_single_filters_report(name, program, listed):
    model, scenes = MODELS[name], SHARED if listed == "one list" else OWN
    if name in ("unicycle", "bicycle"):  # a condition that both inputs enter as early
        pytest.importorskip("jax")
        scenes = ahead(model, scenes)
    many = batch_of(model, scenes, program=program)
    _, info = many.reset()
    reports = [info["safety_filter"]]
    reports += [many.step(u)[4]["safety_filter"] for u in inputs(model)]
    for i in range(N):
        scene = scenes if scenes is SHARED or not isinstance(scenes[0], list) else scenes[i]
        env = wrappers.SafetyFilter(One(model, scene, i), program=program)
        _, info = env.reset()
        for k, report in enumerate(reports):
            single = info["safety_filter"]
            assert single.keys() <= report.keys()
            for key, value in single.items():
                if key == "conditioning" and name in ("unicycle", "bicycle"):
                    continue  # relative to the first function of a signature
                np.testing.assert_allclose(report[key][i], value, atol=1e-9, rtol=1e-9)
            if k < len(reports) - 1:
                info = env.step(inputs(model)[k][i])[4]


def ahead(model, scenes):
    """The same discs, read by a point ahead of a vehicle."""
    import jax.numpy as jnp

    from hcbf_gym.barriers import Function

    def clear(x, t, p):
        point = x[:2] + 0.3 * jnp.stack([jnp.cos(x[2]), jnp.sin(x[2])])
        slow = 0.2 * x[3] if model.n > 3 else 0.0
        return jnp.hypot(*(point - p[:2])) - p[2] - slow

    def seen(disc):
        return Function(disc.name, 1, clear, parameters=np.array([*disc.center, disc.radius]))

    if isinstance(scenes[0], list):
        return [[seen(scene[0])] for scene in scenes]
    return [seen(scenes[0])]


class Malformed(Barrier):
    """A condition of one's own that gives no numbers beyond x = 0.1."""

    def jet(self, x, t=0.0):
        n = len(x)
        gradient = np.zeros(n)
        gradient[0] = -1.0 if x[0] < 0.1 or t == 0.0 else np.nan
        return Jet(float(2.0 - x[0]), gradient, np.zeros((n, n)), 0.0, np.zeros(n), 0.0)


@pytest.mark.filterwarnings("ignore")
def test_a_barrier_that_gives_no_numbers_brakes_the_plants_that_it_gives_none():
    model = MODELS["velocities"]
    many = batch_of(model, [Malformed("malformed", 1)], allow_late_inputs=True)
    many.reset()
    for u in inputs(model):
        beyond = many.unwrapped.x[:, 0] >= 0.1
        moved = many.unwrapped.steps > 0
        report = many.step(np.abs(u))[4]["safety_filter"]
        if moved:
            np.testing.assert_array_equal(report["reason"] == Reason.BARRIERS, beyond)
    assert beyond.any()


@pytest.mark.filterwarnings("ignore")
def test_an_input_that_is_reversed_alarms_for_its_plant_alone():
    model = MODELS["drag"]

    class Reversed(Many):
        def step(self, actions):
            changed = actions.copy()
            changed[3] *= -1.0
            return super().step(changed)

    many = wrappers.VectorSafetyFilter(Reversed(model, [Disc("far", 1, (50.0, 0.0), 1.0)]))
    many.reset()
    for u in inputs(model):
        report = many.step(u)[4]["safety_filter"]
    np.testing.assert_array_equal(report["reason"] == Reason.INPUT, np.arange(N) == 3)


def test_the_scenes_of_an_environment_are_refused_in_words():
    with pytest.raises(InvalidInputError, match="planar double integrator"):
        batch_of(MODELS["drag"], BarrierSet([SHARED] * N, is_placed=True))


class Gap(models.ControlAffine):
    """A double integrator that has no f, or no g, between 0.05 and 0.09 m along x."""

    def __init__(self, part, raises):
        def of(name, value):
            def answer(x):
                if name == part and 0.05 < x[0] < 0.09:
                    if raises:
                        raise ValueError("no answer")
                    return np.nan * value(x)
                return value(x)

            return answer

        drift = of("f", lambda x: np.array([x[2], x[3], 0.0, 0.0]))
        super().__init__(drift, of("g", lambda _: np.vstack([np.zeros((2, 2)), np.eye(2)])), 4, 2)


@pytest.mark.parametrize("raises", [False, True])
@pytest.mark.parametrize("part", ["f", "g"])
@pytest.mark.parametrize("what", ["covariance", "lag"])
@pytest.mark.filterwarnings("ignore:safety filter")
def test_a_model_without_an_answer_where_margins_need_it_brakes_its_plant_alone(what, part, raises):
    unknown = {"covariance": np.diag([5e-4, 5e-4, 0.0, 0.0]), "lag": np.array([0.07, 0, 0, 0])}[
        what
    ]
    fields = np.stack([unknown, *[0.0 * unknown] * (N - 1)])
    lies = lambda x, _: Estimate(x)._replace(**{what: fields})  # noqa: E731
    world = Many(Gap(part, raises), SHARED, lies)
    world.x = np.zeros((N, 4))
    filtered = wrappers.VectorSafetyFilter(world)
    filtered.reset(seed=0)
    world.x = np.zeros((N, 4))
    *_, info = filtered.step(np.zeros((N, 2)))
    reason = info["safety_filter"]["reason"]
    assert reason.tolist() == [Reason.BARRIERS, *[Reason.NONE] * (N - 1)]
    assert info["safety_filter"]["status"][0] == FilterStatus.BACKUP
