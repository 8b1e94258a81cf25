"""Nothing unknown passes the filter, whatever its model: it brakes with a reason, and continues."""

import re
from dataclasses import dataclass

import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import Estimate, models, wrappers
from hcbf_gym.barriers import Barrier, Disc, HalfPlane, Jet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from tests.worlds import World

T = 0.05
POINT = models.DoubleIntegrator()
MODELS = (models.DoubleIntegrator(), models.DoubleIntegrator(drag=0.1))
ISLAND = Disc("island", 1, center=(3.0, 0.0), radius=1.0)
PUSH = np.array([2.0, 0.0])
MALFORMED = [
    None,
    "north",
    True,
    object(),
    np.nan,
    1.0,
    [0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, np.nan],
    [0.0, np.inf, 0.0, 0.0],
    [0.0, 0.0, 0.0, 1j],
    [[0.0, 0.0], [0.0, 0.0]],
    [0.0, [1.0], 0.0, 0.0],
    [None] * 4,
    [True] * 4,
    ["0"] * 4,
]


def label(value):
    """Return a value's name, the same in every process."""
    return re.sub(r" at 0x\w+", "", repr(value))


class Reader:
    """Returns the truth, or for one call what `sends` holds."""

    def __init__(self):
        self.sends = []

    def __call__(self, env, observation, info):
        return self.sends.pop(0) if self.sends else env.x.copy()


def filtered(barriers=(ISLAND,), **plant):
    reader = Reader()
    fields = {"period": T, **plant}
    world = World(POINT, T, limit=2.0)
    env = wrappers.SafetyFilter(
        world,
        "lex-cbf-qp",
        plant=hcbf_gym.Plant(model=POINT, barriers=barriers, state=reader, **fields),
        solver=None if models.DoubleIntegrator() == POINT else "daqp",
    )
    return env, reader, world


@pytest.fixture(autouse=True, scope="module", params=MODELS, ids=["compiled", "general"])
def core(request):
    """Run every test with the compiled core, and with that of any model."""
    globals()["POINT"] = request.param


def steps(env, count, action=PUSH):
    """The last info of several steps."""
    infos = [env.step(action)[-1] for _ in range(count)]
    return infos[-1]


def answers(info):
    report = info["safety_filter"]
    return FilterStatus(report["status"]), Reason(report["reason"])


def braked(info):
    return answers(info)[0] == FilterStatus.BACKUP


def moving(**arguments):
    """A plant on its way at some speed."""
    env, reader, world = filtered(**arguments)
    env.reset(seed=0)
    for _ in range(10):
        env.step(PUSH)
    return env, reader, world


@pytest.mark.parametrize("malformed", MALFORMED, ids=label)
def test_an_invalid_state_brakes_at_once_and_the_filter_continues_after_it(malformed):
    env, reader, world = moving()
    speed = world.x[2]
    reader.sends = [malformed]
    with pytest.warns(UserWarning, match="the filter brakes until that ends"):
        *_, info = env.step(PUSH)
    assert answers(info) == (FilterStatus.BACKUP, Reason.STATE)
    assert world.applied[-1][0] == -2.0
    assert world.x[2] < speed
    *_, info = env.step(PUSH)
    assert answers(info) == (FilterStatus.NOMINAL, Reason.NONE)
    np.testing.assert_array_equal(world.applied[-1], PUSH)
    reader.sends = [malformed]
    *_, info = env.step(PUSH)  # the warning came once
    assert answers(info) == (FilterStatus.BACKUP, Reason.STATE)


def test_a_nan_state_of_a_vehicle_brakes_it_to_rest():
    """Its inputs are its speeds, so that it stands under none."""
    unicycle = models.Unicycle()
    state = lambda env, *_: env.x if len(env.applied) < 2 else np.full(3, np.nan)  # noqa: E731
    plant = hcbf_gym.Plant(unicycle, [ISLAND], state, period=T)
    with pytest.warns(UserWarning, match="allowed"):
        env = wrappers.SafetyFilter(World(unicycle, T, 1.0), plant=plant, allow_late_inputs=True)
    env.reset(seed=0)
    env.step(np.ones(2))
    assert answers(steps(env, 1, np.ones(2)))[1] == Reason.NONE
    with pytest.warns(UserWarning, match="brakes"):
        info = steps(env, 1, np.ones(2))
    assert answers(info) == (FilterStatus.BACKUP, Reason.STATE)
    np.testing.assert_array_equal(env.unwrapped.applied[-1], [0.0, 0.0])


def test_without_sensors_the_plant_stops_by_its_model_and_stands():
    env, reader, world = moving()
    reader.sends = [None] * 40
    with pytest.warns(UserWarning, match="not finite"):
        info = steps(env, 40)
    np.testing.assert_allclose(world.x[2:], 0.0, atol=1e-3)
    np.testing.assert_allclose(world.applied[-1], 0.0, atol=1e-2)
    stopped = world.x[0]
    assert stopped < 2.0
    assert info["safety_filter"]["slack"].shape == (1,)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"covariance": np.full((4, 4), np.nan)}, Reason.STATE),
        ({"covariance": np.eye(3)}, Reason.STATE),
        ({"covariance": -np.eye(4)}, Reason.STATE),
        ({"covariance": np.eye(4) + 2.0}, Reason.NONE),
        ({"covariance": np.eye(4) + 2.0 * (1 - np.eye(4))}, Reason.STATE),
        ({"covariance": "wide"}, Reason.STATE),
        ({"lag": np.full(4, np.inf)}, Reason.STATE),
        ({"lag": np.zeros(2)}, Reason.STATE),
        ({"model": [0.0, 0.0, 0.0, None]}, Reason.STATE),
        ({"age": 0.1}, Reason.NONE),
        ({"age": 0.11}, Reason.AGE),
        ({"age": -0.1}, Reason.NONE),  # ahead by what two clocks may differ
        ({"age": -0.11}, Reason.AGE),
        ({"age": np.nan}, Reason.AGE),
        ({"age": "old"}, Reason.AGE),
        ({"time": np.nan}, Reason.CLOCK),
        ({"time": [1.0, 2.0]}, Reason.CLOCK),
        ({"time": None}, Reason.NONE),
        ({"fault": 3}, Reason.STATE),
        ({"fault": 1000}, Reason.STATE),
        ({"fault": None}, Reason.NONE),
        ({"fault": np.nan}, Reason.STATE),
    ],
    ids=repr,
)
@pytest.mark.filterwarnings("ignore:safety filter")
def test_every_part_of_an_estimate_is_looked_at_as_it_is_at_a_reset(fields, reason):
    env, reader, world = moving(max_age=0.1)
    reader.sends = [Estimate(world.x.copy())._replace(**fields)]
    *_, info = env.step(PUSH)
    assert (braked(info), answers(info)[1]) == (bool(reason), reason)
    reader.sends = [Estimate(np.zeros(4))._replace(**fields)]
    _, info = env.reset(seed=0)
    assert (braked(info), answers(info)[1]) == (bool(reason), reason)


@pytest.mark.filterwarnings("ignore:safety filter. the plant's period is not known")
def test_a_plant_declares_how_it_brakes_and_nonsense_from_it_is_the_input_nearest_0():
    for brake, period, expected in (
        ([-1.0, 0.5], T, (-1.0, 0.5)),
        (lambda x: [-9.0, x[1]], T, (-2.0, 0.0)),
        (lambda x: [np.nan, 0.0], T, (0.0, 0.0)),
        (lambda x: None, T, (0.0, 0.0)),
        ([-1.0, 0.5], None, (-1.0, 0.5)),
        (None, None, (0.0, 0.0)),
    ):
        env, reader, world = moving(brake=brake, period=period)
        reader.sends = [None]
        with pytest.warns(UserWarning, match="brakes"):
            env.step(PUSH)
        np.testing.assert_allclose(world.applied[-1], expected, atol=1e-12)


def test_before_the_first_good_state_it_applies_what_the_plant_declared_or_nothing():
    for brake, expected in (([-1.0, 0.0], -1.0), (None, 0.0), (lambda x: [-1.0, 0.0], 0.0)):
        env, reader, world = filtered(brake=brake)
        reader.sends = [None, None]
        with pytest.warns(UserWarning, match="brakes"):
            _, info = env.reset(seed=0)
        assert answers(info) == (FilterStatus.BACKUP, Reason.STATE)
        env.step(PUSH)
        assert world.applied[-1][0] == expected


@dataclass(frozen=True)
class Own(Barrier):
    """A user's own barrier, which returns what it is given."""

    sends: object = None

    def jet(self, x, t=0.0):
        good = Jet(5.0 - x[0], np.array([-1.0, 0, 0, 0]), np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)
        return good if self.sends is None else self.sends(good)


MALFORMED_BARRIERS = [
    None,
    "wall",
    7,
    ["wall"],
    [None],
    [Disc],
    HalfPlane("wall", 1),
    {"wall": 1},
    [Own("own", 1, lambda jet: jet._replace(h=np.nan))],
    [Own("own", 1, lambda jet: jet._replace(h=None))],
    [Own("own", 1, lambda jet: jet._replace(gradient=np.full(4, np.nan)))],
    [Own("own", 1, lambda jet: jet._replace(gradient=np.ones(3)))],
    [Own("own", 1, lambda jet: jet._replace(hessian=np.full((4, 4), np.inf)))],
    [Own("own", 1, lambda jet: jet._replace(rate=1e308, h=1e308))],
    [Own("own", 1, lambda jet: None)],
    [Own("own", 1, lambda jet: 3.0)],
]


@pytest.mark.parametrize("malformed", MALFORMED_BARRIERS, ids=label)
def test_barriers_that_are_none_brake_at_a_reset_and_in_a_step(malformed):
    given = [[ISLAND]]
    env, _, world = filtered(barriers=lambda env, observation, info: given[0])
    env.reset(seed=0)
    env.step(PUSH)
    given[0] = malformed
    with pytest.warns(UserWarning, match="not finite or not barriers"):
        *_, info = env.step(PUSH)
    assert answers(info) == (FilterStatus.BACKUP, Reason.BARRIERS)
    assert world.applied[-1][0] < 0.0
    _, info = env.reset(seed=0)
    assert answers(info) == (FilterStatus.BACKUP, Reason.BARRIERS)
    given[0] = [ISLAND]
    *_, info = env.step(PUSH)
    assert answers(info) == (FilterStatus.NOMINAL, Reason.NONE)


@pytest.mark.parametrize("malformed", MALFORMED_BARRIERS[:8], ids=label)
def test_what_does_not_change_is_refused_at_construction(malformed):
    with pytest.raises(InvalidInputError, match="expected"):
        filtered(barriers=malformed)


def test_an_empty_list_is_nothing_to_keep():
    env, _, world = filtered(barriers=lambda env, observation, info: [])
    for policy in (PUSH, 3.0 * PUSH):
        _, info = env.reset(seed=0)
        assert answers(info) == (FilterStatus.NOMINAL, Reason.NONE)
        *_, info = env.step(policy)
        np.testing.assert_allclose(world.applied[-1], PUSH)
        assert info["safety_filter"]["slack"].shape == (0,)


@pytest.mark.parametrize("on_alarm", ["warn", "brake"])
def test_an_alarm_of_the_plant_lasts_until_the_reset(on_alarm):
    env, reader, world = moving(on_alarm=on_alarm)
    reader.sends = [Estimate(world.x.copy(), fault=np.int64(Reason.SLIP))]
    with pytest.warns(UserWarning, match="until the next reset"):
        env.step(PUSH)
    for _ in range(20):
        *_, info = env.step(0.1 * PUSH)
        status, reason = answers(info)
        assert reason == Reason.SLIP
        assert (status == FilterStatus.BACKUP) == (on_alarm == "brake")
    assert (abs(world.x[2]) < 1e-2) == (on_alarm == "brake")
    _, info = env.reset(seed=0)
    assert answers(info) == (FilterStatus.NOMINAL, Reason.NONE)


def test_a_report_has_the_same_keys_and_types_whatever_happens():
    env, reader, _ = filtered()
    _, first = env.reset(seed=0)
    *_, second = env.step(PUSH)
    reader.sends = [None]
    with pytest.warns(UserWarning, match="brakes"):
        *_, third = env.step(PUSH)
    for info in (second, third):
        for key, value in first["safety_filter"].items():
            other = info["safety_filter"][key]
            assert (other.shape, other.dtype) == (value.shape, value.dtype), key
    for code in ("status", "reason", "covered", "covered_by", "proved"):
        assert third["safety_filter"][code].dtype == np.int64


def test_an_unknown_period_is_a_warning_and_no_error():
    with pytest.warns(UserWarning, match="period is not known"):
        env, reader, world = filtered(period=None)
    env.reset(seed=0)
    *_, info = env.step(PUSH)
    assert answers(info) == (FilterStatus.NOMINAL, Reason.NONE)
    reader.sends = [None]
    with pytest.warns(UserWarning, match="brakes"):
        env.step(PUSH)
    np.testing.assert_array_equal(world.applied[-1], 0.0)
