"""Every public function refuses wrong types with an HcbfError, and u comes back as u* came."""

import warnings
from enum import Enum
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.wrappers.vector import DictInfoToList

import hcbf_gym
from hcbf_gym import HcbfError, barriers, estimation, models, programs, scenarios, wrappers
from hcbf_gym.errors import InvalidInputError
from tests import public_calls
from tests.public_calls import loose, torch

pytestmark = pytest.mark.filterwarnings("ignore")

NOT_CALLED = {
    hcbf_gym: {"HcbfError"},
    estimation: {"Estimator"},  # the A1's environment makes it
    barriers: {"Barrier", "ClassK", "PlanarBarrier", "Shape"},  # abstract
    programs: {"BatchProgram", "Prices", "Program"},  # `make` and `make_batch` make them
    scenarios: {"Family", "register_floors"},  # `register` makes one, packages call the other
}
"""Names that are called by others, or not at all."""


@pytest.fixture(scope="module")
def calls():
    return public_calls.calls()


def test_wrong_values_in_every_place_of_every_call_are_refused_in_words(calls):
    kept, failures, count = np.random.default_rng(0), [], 0
    hostile = public_calls.hostile
    for name, call in calls.items():
        for place in call.places():
            values = hostile()
            labels = list(values)
            for label in kept.choice(labels, 20, replace=False).tolist():
                count += 1
                try:
                    answer = call.of(**{**call.given, place: values[label]})
                except HcbfError as error:
                    if "expected" not in str(error):
                        failures.append(f"{name}({place}={label}): message {error}")
                except Exception as error:  # which is the failure
                    failures.append(f"{name}({place}={label}): {type(error).__name__}: {error}")
                else:
                    failures += [f"{name}({place}={label}): {found}" for found in dtypes(answer)]
    assert count >= 500
    assert not failures, "\n".join(failures)


def dtypes(answer):
    """Yield the types of arrays that hold no u and no report."""
    if isinstance(answer, dict):
        answer = tuple(answer.values())
    for one in answer if isinstance(answer, tuple | list) else ():
        if isinstance(one, np.ndarray) and one.dtype.char in "eGFDO":
            yield one.dtype


def test_each_public_name_is_called(calls):
    called = {id(call.of) for call in calls.values()}
    called |= {id(getattr(call.of, "__func__", None)) for call in calls.values()}
    names = {name.partition(" ")[0].partition(".")[0].partition("(")[0] for name in calls}
    for room in public_calls.ROOMS:
        if room is hcbf_gym.certificates:  # its records have suites of their own
            continue
        left = {
            name
            for name in room.__all__
            if not (id(getattr(room, name)) in called or name in names)
            and callable(getattr(room, name))
            and not is_record(getattr(room, name))
        }
        assert left <= NOT_CALLED.get(room, set()), (room.__name__, left)


def is_record(thing):
    """Return whether something checks nothing itself: records, choices, protocols, aliases."""
    alias = not isinstance(thing, type) and not hasattr(thing, "__code__")
    record = isinstance(thing, type) and hasattr(thing, "_fields")
    protocol = getattr(thing, "_is_protocol", False)
    choice = isinstance(thing, type) and issubclass(thing, Enum)
    abstract = bool(getattr(thing, "__abstractmethods__", None))
    return alias or record or protocol or choice or abstract


NUMPY = [np.float64, np.float32]
TORCH = [] if torch is None else [torch.float64, torch.float32]


@pytest.mark.parametrize("dtype", [*NUMPY, *TORCH], ids=str)
def test_u_comes_back_in_the_type_of_u_star_and_is_the_one_that_is_reported(dtype):
    rng = np.random.default_rng(0)
    filt = hcbf_gym.BatchFilter(models.Box.symmetric(5.0), 0.02, 50)
    filt.set_scene([barriers.Disc("disc", 1, (1.0, 0.1), 0.5), barriers.SpeedLimit("cap", 1, 2.0)])
    x = np.column_stack([rng.uniform(-0.5, 0.4, (50, 2)), rng.uniform(-1.0, 1.0, (50, 2))])
    filt.reset(x=x)
    wanted = rng.uniform(-6.0, 6.0, (50, 2))
    library: Any = torch.as_tensor if dtype in TORCH else np.asarray
    u, report = filt(library(wanted, dtype=dtype), library(x))
    assert type(u) is type(report["u_safe"]) is type(library(wanted))
    assert u.dtype == dtype
    reported = np.asarray(report["u_safe"])
    np.testing.assert_array_equal(np.asarray(u, dtype=np.float64), reported)
    assert (np.asarray(report["status"]) > 0).any()
    if "float32" in str(dtype):
        np.testing.assert_array_equal(reported, reported.astype(np.float32))
    assert np.asarray(report["slack"])[np.asarray(report["status"]) == 1].max() == 0.0


REFUSED: dict[str, Any] = {
    "int64": np.ones((3, 2), dtype=np.int64),
    "half": np.ones((3, 2), dtype=np.float16),
    "long": np.ones((3, 2), dtype=np.longdouble),
    "bool": np.ones((3, 2), dtype=bool),
    "complex": np.ones((3, 2), dtype=complex),
    "object": np.ones((3, 2), dtype=object),
}
if torch is not None:
    REFUSED |= {
        "bfloat16": torch.ones(3, 2, dtype=torch.bfloat16),
        "torch half": torch.ones(3, 2, dtype=torch.float16),
        "torch int64": torch.ones(3, 2, dtype=torch.int64),
        "sparse": torch.ones(3, 2).to_sparse(),
    }


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_hold_u_is_refused_by_every_filter_and_environment(name):
    given = REFUSED[name]
    batch, cart = public_calls.batch(), public_calls.velocity()
    env, vector = public_calls.filtered(), wrappers.VectorSafetyFilter(public_calls.native())
    regions, program = public_calls.regions(), programs.make("lex-cbf-qp")
    vector.reset(seed=0)
    regions.reset(seed=0)
    many = programs.make_batch("lex-cbf-qp")
    rows = programs.CbfRows(*(np.stack([part] * 3) for part in public_calls.ROWS[:4]))
    for call in (
        lambda: batch(given, np.zeros((3, 4))),
        lambda: batch(np.zeros((3, 2)), given[:, [0, 1, 0, 1]] if name != "sparse" else given),
        lambda: cart.step(given[0], np.zeros(3), np.zeros(3), 0.0),
        lambda: env.step(given[0]),
        lambda: vector.step(given[:2] if name != "sparse" else given),
        lambda: regions.step(given[0]),
        lambda: program(given[0], public_calls.ROWS),
        lambda: many(given, rows),
    ):
        with pytest.raises(InvalidInputError, match="got"):
            call()


@pytest.mark.parametrize(
    "space",
    [
        spaces.Box(-5, 5, (2,), np.int64),
        spaces.Box(0, 255, (2,), np.uint8),
        spaces.Box(-5.0, 5.0, (2,), np.float16),
        spaces.Box(-5.0, 5.0, (3,), np.float32),
        spaces.Discrete(4),
        spaces.MultiBinary(2),
        spaces.MultiDiscrete([3, 3]),
    ],
    ids=str,
)
@pytest.mark.parametrize("input_set", [None, models.Box.symmetric(5.0)])
def test_an_action_space_that_cannot_hold_u_is_refused(space, input_set):
    plant = hcbf_gym.Plant(
        models.DoubleIntegrator(), [public_calls.DISC], public_calls.state, input_set, period=0.02
    )
    with pytest.raises(InvalidInputError, match=r"action space|inputs: got"):
        wrappers.SafetyFilter(loose(space), plant=plant)


def test_actions_of_any_space_are_translated():
    plant = hcbf_gym.Plant(
        models.DoubleIntegrator(), [public_calls.DISC], public_calls.state,
        models.Box.symmetric(5.0), period=0.02, to_action=np.asarray,
        from_action=lambda action: np.array([[1.0, 0.0], [0.0, 1.0]])[action],
    )  # fmt: skip
    env = wrappers.SafetyFilter(loose(spaces.Discrete(2)), plant=plant)
    env.reset(seed=0)
    *_, info = env.step(1)
    np.testing.assert_array_equal(info["safety_filter"]["u_nominal"], [0.0, 1.0])


@pytest.mark.parametrize("dtype", NUMPY, ids=str)
def test_a_robot_is_commanded_in_the_type_of_the_command(dtype):
    cart = public_calls.velocity()
    command, _ = cart.step(np.array([0.3, 0.1], dtype=dtype), np.zeros(3), np.zeros(3), 0.0)
    assert command.dtype == dtype
    np.testing.assert_array_equal(cart.command_at(0.01), command.astype(np.float64))


def test_a_spec_with_a_plant_given_by_hand_explains_how_it_becomes_plain():
    env = gym.make("HCBF-Regions-v0", scenario="random")
    plant = env.unwrapped.plant
    for filtered in (
        wrappers.SafetyFilter(env, plant=plant),
        wrappers.HoldAction(wrappers.SafetyFilter(env, plant=plant), 2),
    ):
        with pytest.raises(InvalidInputError, match=r"self\.plant = hcbf_gym\.Plant"):
            filtered.spec.to_json()
        assert gym.make(filtered.spec).get_wrapper_attr("plant") is plant
    assert wrappers.SafetyFilter(env).spec.to_json()


def test_infos_of_another_form_inside_are_named():
    inside = DictInfoToList(public_calls.native())
    with pytest.raises(InvalidInputError, match=r"DictInfoToList\(VectorSafetyFilter\(env\)\)"):
        wrappers.VectorSafetyFilter(inside)


def test_a_conflict_is_reported_for_an_action_space():
    rows = public_calls.ROWS._replace(b=np.array([4.0, 4.0]))
    result = programs.make("lex-cbf-qp")(np.zeros(2), rows)
    space = spaces.Box(-5.0, 5.0, (2,), np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = programs.conflict_report(rows, result, space)
    assert found == programs.conflict_report(rows, result, models.Box.symmetric(5.0))
    assert found.rows == (0, 1)
