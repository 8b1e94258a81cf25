"""What an h of one's own reserves: by its gradient, wherever it reads, on the planar model too."""

import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, models
from hcbf_gym.barriers import Disc
from hcbf_gym.models import Box, Uncertainty
from tests.barriers.readable import reserved
from tests.filtering.cores import core_of
from tests.worlds import OwnLinear

jax = pytest.importorskip("jax")
jnp = jax.numpy

from hcbf_gym.barriers import Function  # noqa: E402

PERIOD = 0.05
X = np.array([0.5, 0.2, 0.4, -0.3])
ROOT = np.array([[0.1, 0, 0, 0], [0.05, 0.12, 0, 0], [0.01, 0, 0.05, 0], [0, 0.02, 0.03, 0.04]])
P = ROOT @ ROOT.T
MODELS = {"planar": models.DoubleIntegrator(), "drag": models.DoubleIntegrator(drag=0.5)}


H = {
    "twice as steep": Function("steep", 1, lambda x, t: 2.0 * (4.0 - jnp.hypot(x[0], x[1]))),
    "half as steep": Function("flat", 2, lambda x, t: 0.5 * (4.0 - x[0])),
    "speed": Function("speed", 1, lambda x, t: 4.0 - x[2] ** 2 - x[3] ** 2),
    "braking distance": Function("brakes", 1, lambda x, t: 4.0 - x[0] - 0.5 * x[2] ** 2),
    "own class": OwnLinear("own", 1, (-3.0, 0.0, 0.0, -0.5), 9.0),
}


def report_of(name, conditions, declared, count=None, **estimate):
    plant = Plant(
        MODELS[name], conditions, lambda *_: None, Box.symmetric(2.0), period=PERIOD,
        uncertainty=declared,
    )  # fmt: skip
    core = core_of(plant, count=count, rows="usual")
    given = {"x": X, **estimate}
    given = {k: v if count is None else np.stack([v] * count) for k, v in given.items()}
    return core.begin(conditions, Estimate(**given), None, None)


def jet_of(h):
    return h.jet(X, 0.0)


@pytest.mark.parametrize("count", [None, 3])
@pytest.mark.parametrize("what", H)
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.filterwarnings("ignore")
def test_the_gradient_determines_what_an_own_condition_reserves(name, what, count):
    declared = Uncertainty(distance=0.1, body=0.2)
    none = report_of(name, [H[what]], Uncertainty(), count)["margin"]
    found = report_of(name, [H[what]], declared, count, covariance=P)["margin"] - none
    jet = jet_of(H[what])
    place, rest = jet.gradient[:2], jet.gradient[2:]
    steep = np.linalg.norm(place) and max(1.0, np.linalg.norm(place))
    spread = steep * np.sqrt(np.linalg.eigvalsh(P[:2, :2])[-1]) + np.sqrt(rest @ P[2:, 2:] @ rest)
    values, vectors = np.linalg.eigh(P)
    root = reserved(3.0, vectors * np.sqrt(np.maximum(values, 0.0)))
    bend = -0.5 * min(0.0, np.linalg.eigvalsh(root.T @ jet.hessian @ root)[0])
    np.testing.assert_allclose(found, 0.3 * steep + reserved(3.0, spread) + bend, rtol=1e-6)


@pytest.mark.parametrize("what", H)
@pytest.mark.filterwarnings("ignore")
def test_no_state_within_the_declared_deviations_loses_more_than_is_reserved(what):
    rng = np.random.default_rng(0)
    h = H[what]
    margin = report_of("drag", [h], Uncertainty(), covariance=P)["margin"][0]
    z = rng.normal(size=(500, 4))
    directions = z / np.linalg.norm(z, axis=1, keepdims=True)
    off = reserved(3.0, directions @ np.linalg.cholesky(P + 1e-15).T)
    assert min(h.h(X + one) for one in off) >= h.h(X) - margin - 1e-6


@pytest.mark.filterwarnings("ignore")
def test_a_disc_of_one_s_own_reserves_what_a_built_in_one_does():
    own = Function("own", 1, lambda x, t: jnp.hypot(x[0] - 3.0, x[1]) - 1.0)
    disc = Disc("built in", 1, (3.0, 0.0), 1.0)
    declared = Uncertainty(0.02, 0.3, 1.0, 0.2, 3.0, 0.4)
    lag = np.array([0.05, 0.02, 0.1, -0.1])
    for name in MODELS:
        seen = report_of(name, [own, disc], declared, covariance=P, lag=lag)
        np.testing.assert_allclose(*seen["margin"], rtol=1e-9)
