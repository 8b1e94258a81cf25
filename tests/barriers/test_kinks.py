"""Where h is finite and its gradient is not, rows are those beside the kink, and nothing enters."""

import math
import warnings

import numpy as np
import pytest

from hcbf_gym import Plant, wrappers
from hcbf_gym.barriers import Barrier, Function, Jet, LinearClassK, PlanarBarrier
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models import ControlAffine, DoubleIntegrator, Reason, SingleIntegrator
from hcbf_gym.programs import FilterStatus
from tests.worlds import World

jnp = pytest.importorskip("jax.numpy")
PERIOD = 0.05
POINT = ControlAffine(
    lambda x: jnp.array([x[2], x[3], 0.0, 0.0]),
    lambda x: jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    n=4, n_u=2,
)  # fmt: skip
MODELS = {
    "planar": DoubleIntegrator(),
    "drag": DoubleIntegrator(drag=0.5),
    "own": POINT,
}


def driven(model, barrier, wanted, start=(0.0, 0.0, 0.0, 0.0), steps=200):
    """Return states, h and reports of a filtered drive, and the warnings about kinks."""
    plant = Plant(model, [barrier], lambda env, x, info: x, period=PERIOD)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env = wrappers.SafetyFilter(
            World(model, PERIOD, 2.0, start), plant=plant, alpha1=LinearClassK(1.0)
        )
        x, info = env.reset()
        seen, reports = [x], [info["safety_filter"]]
        for k in range(steps):
            x, *_, info = env.step(np.asarray(wanted(k, x), dtype=np.float64))
            seen.append(x)
            reports.append(info["safety_filter"])
    texts = [str(one.message) for one in caught if "gradient" in str(one.message)]
    return np.array(seen), reports, texts


class OwnCap(Barrier):
    """``v_max − ‖v‖`` by NumPy, with its own Jacobians: NaN at rest."""

    def jet(self, x, t=0.0):
        v, g, hessian = x[2:4], np.zeros(4), np.zeros((4, 4))
        speed = np.linalg.norm(v)
        g[2:] = -v / speed
        hessian[2:, 2:] = -(np.eye(2) - np.outer(v, v) / speed**2) / speed
        return Jet(float(1.0 - speed), g, hessian, 0.0, np.zeros(4), 0.0)


CAPS = {
    "JAX": Function("cap", 1, lambda x, t: 1.0 - jnp.sqrt(x[2] ** 2 + x[3] ** 2)),
    "NumPy": OwnCap("cap", 1),
}


@pytest.mark.parametrize("cap", CAPS)
@pytest.mark.parametrize("model", MODELS)
def test_a_cap_on_the_norm_of_the_velocity_holds_from_rest_on(model, cap):
    def wanted(k, x):  # drives, stops exactly, and drives elsewhere
        if (k // 40) % 2:
            return np.clip(-x[2:] / PERIOD, -2.0, 2.0)
        return 2.0 * np.array([math.cos(k // 40), math.sin(k // 40)])

    x, reports, texts = driven(MODELS[model], CAPS[cap], wanted)
    assert np.hypot(x[:, 2], x[:, 3]).max() <= 1.0 + 1e-9
    assert np.hypot(x[:, 2], x[:, 3]).max() > 0.8
    assert all(report["reason"] == Reason.NONE for report in reports)
    assert all(report["status"] < FilterStatus.VIOLATED for report in reports)
    assert len(texts) == 1
    assert "cap" in texts[0]


def least(a, b):
    """Return min(a, b), as many write it: its gradient is NaN where a = b."""
    return 0.5 * (a + b - jnp.sqrt((a - b) ** 2))


MINIMA = {
    "corridor": (lambda x, t: least(1.0 - x[1], 1.0 + x[1]), (0.5, 2.0)),
    "two slopes": (lambda x, t: least(1.0 - x[0], 1.0 - 0.5 * x[0]), (2.0, 1.0)),
    "inside a disc": (lambda x, t: 1.5 - jnp.sqrt(x[0] ** 2 + x[1] ** 2), (2.0, -1.0)),
}


@pytest.mark.parametrize("case", MINIMA)
@pytest.mark.parametrize("model", MODELS)
def test_nothing_is_entered_at_the_kink_of_a_minimum(model, case):
    h, u = MINIMA[case]
    barrier = Function(case, 1, h)
    x, reports, texts = driven(MODELS[model], barrier, lambda k, x: u)
    assert min(float(h(one, 0.0)) for one in x) >= 0.0
    assert min(float(h(one, 0.0)) for one in x) < 0.3
    assert all(report["reason"] == Reason.NONE for report in reports)
    assert len(texts) == 1


def test_a_batch_takes_each_plants_own_direction():
    u, model = np.array([[0.0, 2.0], [3.0, 0.0]]), DoubleIntegrator()
    kinks = Kinks(u)
    for i, x in ((0, np.zeros(4)), (1, np.zeros(4)), (1, np.array([1.0, 1.0, 0.0, -2.0]))):
        d = (next(kinks.states_beside(model, x, i)) - x) / 1e-6
        expected = x[2:] if x.any() else u[i]
        expected = np.tile(expected / np.linalg.norm(expected), 2) / math.sqrt(2.0)
        np.testing.assert_allclose(d, expected, atol=1e-9)


class Flat(PlanarBarrier):
    """A planar shape of one's own whose gradient is NaN in all of its inside."""

    def planar_jet(self, q):
        s = q[0] - 1.0
        h = math.sqrt(max(s, 0.0))
        slope = 0.5 / h if s > 0.0 else math.nan
        return h, np.array([slope, 0.0]), np.zeros((2, 2))


@pytest.mark.parametrize(
    "barrier", [Function("flat", 1, lambda x, t: jnp.sqrt(jnp.maximum(x[0], 0.0))), Flat("flat", 1)]
)
@pytest.mark.parametrize("model", [DoubleIntegrator(), SingleIntegrator()])
def test_a_gradient_that_is_not_finite_beside_either_brakes_with_state_and_remedy(model, barrier):
    start = np.full(model.n, -0.5)
    plant = Plant(model, [barrier], lambda env, x, info: x, period=PERIOD)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SafetyWarning)
        env = wrappers.SafetyFilter(World(model, PERIOD, 2.0, start), plant=plant)
        _, info = env.reset()
    texts = " ".join(str(one.message) for one in caught)
    assert info["safety_filter"]["status"] == FilterStatus.BACKUP
    assert info["safety_filter"]["reason"] == Reason.BARRIERS
    for part in ("'flat'", "gradient", "-0.5", "jnp.sqrt(s + 1e-6)"):
        assert part in texts
