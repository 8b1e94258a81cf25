"""What is declared as unknown is reserved on every model, alone and in batches.

A cell is a model, a field of `Estimate` or `Uncertainty`, and one plant or three. The margins grow
by what the field declares, or it has no meaning and is refused.
"""

import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, models
from hcbf_gym.barriers import Disc, HalfPlane, SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Axle, Box, Uncertainty
from hcbf_robots import Response
from hcbf_robots.walkers.walker_margins import uncertainty
from tests.barriers.readable import reserved
from tests.filtering.cores import core_of
from tests.worlds import boat

T, LARGEST = 0.05, np.array([1.5, 0.5])
WALL = HalfPlane("wall", 1, (-0.8, 0.6), -3.0)
POST = Disc("post", 2, (2.0, 0.5), 0.5)
CAP = SpeedLimit("cap", 1, 3.0, margin=0.1)
CART = Axle(look_ahead=0.25, forward=3.0, turn=1.8, braking=0.5)
EXACT = Uncertainty()
WALKS = uncertainty(Response(), T)


POINT, MOVING = [0.1, 0.2], [0.1, 0.2, 0.3, -0.1]
MODELS = {  # the model, its state, an axle, and what the plant is off its model in any case
    "planar": (models.DoubleIntegrator(), MOVING, None, EXACT),
    "drag": (models.DoubleIntegrator(drag=0.5), MOVING, None, EXACT),
    "single integrator": (models.SingleIntegrator(), POINT, None, EXACT),
    "unicycle": (models.Unicycle(), [*POINT, 0.4], None, EXACT),
    "bicycle": (models.KinematicBicycle(), [*POINT, 0.4, 0.6], None, EXACT),
    "own": (boat(), MOVING, None, EXACT),
    "axle": (models.DoubleIntegrator(), [0.1, 0.2, 0.3, 0.0], CART, EXACT),
    "walker": (models.DoubleIntegrator(), MOVING, None, WALKS),
}
SPEEDS = ("planar", "drag", "own", "axle", "walker")  # with a speed limit
NO_SPEED = tuple(name for name in MODELS if name not in SPEEDS)
SIZES = {"single": None, "batch": 3}

MEANINGLESS = {("single integrator", "per_velocity")}  # its velocity is the input
MEANINGLESS |= {(name, field) for name in NO_SPEED for field in ("speed", "speed_per_velocity")}
FIELDS = ("model", "lag", "covariance", *Uncertainty._fields)  # no other one is a length
CELLS = [(name, field, size) for name in MODELS for field in FIELDS for size in SIZES]


def state_of(name):
    return np.array(MODELS[name][1])


def report_of(name, size, declared=EXACT, conditions=None, **estimate):
    """Return the report of the first sample: of one plant, or of the last of three."""
    model, x, axle, own = MODELS[name]
    own = Uncertainty(*np.add(own, declared))._replace(confidence=declared.confidence)
    conditions = conditions or [WALL, POST, *([CAP] if name in SPEEDS else [])]
    plant = Plant(
        model, conditions, lambda *_: None, Box(-LARGEST, LARGEST), period=T, uncertainty=own,
        axle=axle,
    )  # fmt: skip
    count = SIZES[size]
    core = core_of(plant, count=count)
    given = {"x": np.array(x), "heading": np.zeros(()) if axle else None, "time": np.zeros(())}
    given |= {key: np.asarray(value) for key, value in estimate.items()}
    if count is not None:  # the others declare nothing

        def of_all(key, one):
            others = np.array(x) if key in ("x", "model") else np.zeros(np.shape(one))
            return np.stack([others, others, one])

        given = {key: of_all(key, one) for key, one in given.items() if one is not None}
    report = core.begin(conditions, Estimate(**given), None, None)
    if count is None:
        return report
    return {key: value[-1] for key, value in report.items() if np.ndim(value) > 0}


def margins(name, size, declared=EXACT, **estimate):
    """Return what wall, post and cap reserve; None without a cap."""
    margin = report_of(name, size, declared, **estimate)["margin"]
    return np.array([*margin, *([np.nan] if name not in SPEEDS else [])])


def normals(name):
    """Return the unit normals of wall and post, where the rows read them."""
    x = state_of(name)[:2] - np.array([CART.look_ahead if name == "axle" else 0.0, 0.0])
    return np.array(WALL.normal), (x - POST.center) / np.linalg.norm(x - POST.center)


def covariance_of(name, confidence=3.0):
    """Return P, and what it adds to the rows, as it is and by what a heading turns in a hold."""
    n = len(state_of(name))
    root = np.zeros((n, n))
    root[:2, :2] = [[0.1, 0.0], [0.05, 0.12]]
    if n == 4 and name != "bicycle":
        root[2:, 2:] = [[0.05, 0.0], [0.03, 0.04]]
    elif n > 2:
        root[2:, 2:] = np.diag([1e-3, 2e-3][: n - 2])
    covariance = root @ root.T
    wall, _ = normals(name)
    held = hold_of(name, covariance)
    deviation = [
        np.sqrt(wall @ covariance[:2, :2] @ wall) + T * np.sqrt(wall @ held @ wall),
        sum(
            share * np.sqrt(np.linalg.eigvalsh(one)[-1])
            for share, one in ((1.0, covariance[:2, :2]), (T, held))
        ),
        np.sqrt(np.linalg.eigvalsh(covariance[2:, 2:])[-1]) if name in SPEEDS else np.nan,
    ]
    return covariance, reserved(confidence, np.array(deviation))


def hold_of(name, covariance):
    """Return the covariance of what the largest inputs make of ṗ."""
    x = state_of(name)
    if name not in ("unicycle", "bicycle"):
        return np.zeros((2, 2))
    e = np.array([np.cos(x[2]), np.sin(x[2])])
    across = np.array([-e[1], e[0]])
    if name == "unicycle":
        turned = LARGEST[0] * across[:, None]
    else:
        turned = LARGEST[1] * np.stack([-x[3] * e, across], axis=1)
    return turned @ covariance[2:, 2:] @ turned.T


def lag_of(name, velocity):
    """Return a lag in velocity, as far as the model has one, and by how much ṗ differs then."""
    x = state_of(name)
    lag = np.zeros(len(x))
    if name == "unicycle":
        lag[2] = velocity
        turned = [np.cos(x[2] + velocity) - np.cos(x[2]), np.sin(x[2] + velocity) - np.sin(x[2])]
        return lag, np.zeros(2), LARGEST[0] * np.array(turned)
    if name == "bicycle":
        lag[3] = velocity
        e = np.array([np.cos(x[2]), np.sin(x[2])])
        return lag, velocity * e, LARGEST[1] * velocity * np.array([-e[1], e[0]])
    lag[2] = velocity
    return lag, lag[2:4].copy(), np.zeros(2)


def grown_by(name, size, field):
    """Return what the margins grow by, and what they should."""
    wide = {"cap": 1.0}
    before = margins(name, size)
    at = np.array(normals(name))
    if field == "covariance":
        covariance, expected = covariance_of(name)
        return margins(name, size, covariance=covariance) - before, expected
    if field in ("lag", "model"):
        off = np.zeros(len(before) + 1)[: len(state_of(name))]
        off[0] = 0.2
        nearer = np.append(np.maximum(0.0, -at @ [0.2, 0.0]), 0.0 if name in SPEEDS else np.nan)
        given = {"lag": off} if field == "lag" else {"model": state_of(name) + off}
        lead = MODELS[name][3].per_lead * np.maximum(0.0, at @ [0.2, 0.0])
        assert not lead.any()
        return margins(name, size, **given) - before, nearer
    none = np.zeros(2)
    rows = {"distance": 1.0, "body": 1.0}
    if field in rows:
        expected = np.append(none + 0.3, 0.0)
        return margins(name, size, EXACT._replace(**{field: 0.3})) - before, expected
    if field == "speed":
        return margins(name, size, EXACT._replace(speed=0.2)) - before, np.append(none, 0.2)
    if field == "speed_per_velocity":
        lag = np.zeros(len(state_of(name)))
        lag[2] = 0.3
        declared = EXACT._replace(speed_per_velocity=0.5)
        return (
            margins(name, size, declared, lag=lag) - margins(name, size, lag=lag),
            np.append(none, 0.15),
        )
    if field == "confidence":
        covariance, expected = covariance_of(name)
        more = margins(name, size, EXACT._replace(confidence=4.5), covariance=covariance)
        expected = covariance_of(name, 4.5)[1] - expected
        return more - margins(name, size, covariance=covariance), expected
    if field == "per_velocity":
        lag, drift, of_input = lag_of(name, 0.3)
        faster = np.maximum(0.0, -at @ drift + np.abs(at @ of_input))
        declared = EXACT._replace(**wide)
        more = margins(name, size, declared._replace(per_velocity=0.5), lag=lag)
        return more - margins(name, size, declared, lag=lag), np.append(0.5 * faster, 0.0)
    lag = np.zeros(len(state_of(name)))
    lag[0] = -0.3
    lead = np.maximum(0.0, at @ [-0.3, 0.0])
    declared = EXACT._replace(**wide)
    if field == "per_lead":
        more = margins(name, size, declared._replace(per_lead=0.5), lag=lag)
        return more - margins(name, size, declared, lag=lag), np.append(0.5 * lead, 0.0)
    assert field == "cap"
    declared = EXACT._replace(per_lead=2.0)
    own = MODELS[name][3]
    most = (own.per_lead + 2.0) * lead
    more = margins(name, size, declared._replace(cap=0.05), lag=lag)
    expected = np.minimum(most, own.cap + 0.05) - np.minimum(most, own.cap)
    return more - margins(name, size, declared, lag=lag), np.append(expected, 0.0)


@pytest.mark.filterwarnings("ignore:.*safety filter", "ignore::hcbf_gym.errors.CoverageWarning")
@pytest.mark.parametrize(("name", "field", "size"), CELLS)
def test_what_is_declared_is_reserved(name, field, size):
    if (name, field) in MEANINGLESS:
        with pytest.raises(InvalidInputError, match=f"uncertainty: {field}: got 0.3 with"):
            report_of(name, size, EXACT._replace(**{field: 0.3}))
        return
    found, expected = grown_by(name, size, field)
    if name not in SPEEDS:
        expected[2] = np.nan
    loose = field in ("covariance", "confidence") and name in ("unicycle", "bicycle")
    np.testing.assert_allclose(found, expected, atol=1e-6 if loose else 1e-9)
    assert np.nanmax(expected) > 0.01
