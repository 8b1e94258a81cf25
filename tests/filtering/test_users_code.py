"""A user's own code may raise anything, and a refused barrier stays refused: the robot brakes."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

from hcbf_gym import Plant
from hcbf_gym.barriers import (
    Barrier,
    Disc,
    Jet,
    LinearClassK,
    LogClassK,
    PlanarBarrier,
    SpeedLimit,
    class_k,
)
from hcbf_gym.barriers.barrier import Core
from hcbf_gym.certificates import Judged
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.filter.certified import CertificateCoverage
from hcbf_gym.models import (
    Ball,
    Box,
    ControlAffine,
    Coverage,
    CoveredBy,
    DoubleIntegrator,
    Reason,
)
from hcbf_gym.models.plant import EXACT, Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from tests.certificates.test_certificate import made
from tests.worlds import World

MODELS = {"planar": DoubleIntegrator(), "with drag": DoubleIntegrator(drag=0.5)}
T, REST = 0.05, np.zeros(2)
pytestmark = pytest.mark.filterwarnings(
    "ignore::hcbf_gym.errors.SafetyWarning", "ignore:safety filter:UserWarning"
)


class OddError(Exception):
    """Derives from no class that reading raises."""


class SilentError(Exception):
    """Raises another error where its text is read."""

    def __str__(self):
        raise OddError

    __repr__ = __str__


class Unreadable:
    """An object that raises an error whatever is read of it."""

    def __getattr__(self, name):
        raise OddError(name)

    def __array__(self, *_, **__):
        raise OddError("no array")

    def __eq__(self, other):
        raise OddError("not comparable")

    __hash__ = None

    def __repr__(self):
        raise OddError("no text")

    __copy__ = __deepcopy__ = __str__ = __repr__


def no_numbers(valid):
    """Name → what a user's code may return in the place of an array of real numbers."""
    hidden = np.ma.masked_array(valid, np.arange(valid.size).reshape(valid.shape) == 0)
    return {
        "none": None,
        "text": "ab",
        "texts": valid.astype(str),
        "complex": valid + 1j,
        "complex of no imaginary part": valid + 0j,
        "objects": valid.astype(object),
        "truth values": valid > 0.0,
        "masked": hidden,
        "half precision": valid.astype(np.float16),
        "beyond 64 bits": valid.astype(np.longdouble),
        "another shape": np.zeros(valid.size + 1),
        "one more axis": valid[None],
        "unreadable": Unreadable(),
        "nan": np.full(valid.shape, np.nan),
    }


class Own(Barrier):
    """A wall of a user's own, whose jet fails on request."""

    error: type[Exception] | None = None

    def jet(self, x, t=0.0):
        if self.error is not None:
            raise self.error("no measurement")
        return Jet(5.0 + x[0], np.eye(4)[0], np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)


class Late(Barrier):
    """A condition that u₀ moves at once and u₁ later, so that its row misses u₁."""

    def jet(self, x, t=0.0):
        gradient = np.array([0.0, 1.0, 1.0, 0.0])
        return Jet(5.0 + x[1] + x[2], gradient, np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)


def statuses(model, scene_at, steps=6, uncertainty=EXACT, world=None, **options):
    """The status of steps whose barriers are a disc that moves on, and those of `scene_at`."""
    step = [0]

    def barriers(env, x, info):
        return [Disc("disc", 1, (20.0 + 0.001 * step[0], 0.3), 0.5), *scene_at(step[0])]

    plant = Plant(model, barriers, lambda env, x, info: x, period=T, uncertainty=uncertainty)
    env = SafetyFilter(World(world or model, T, 2.0, (0.0,) * 4), plant=plant, **options)
    env.reset()
    found = []
    for step[0] in range(1, steps + 1):
        _, _, _, _, info = env.step(REST)
        found.append(int(info["safety_filter"]["status"]))
    return found


def brakes_from_the_third_step(found):
    return [status == FilterStatus.BACKUP for status in found] == [False] * 2 + [True] * 4


@pytest.mark.parametrize("error", [RuntimeError, ValueError, OddError, OSError, SilentError])
@pytest.mark.parametrize("appears", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_a_barrier_that_raises_anything_makes_the_robot_brake(model, appears, error):
    own = Own("own", 1)

    def scene(step):
        own.error = error if step > 2 else None
        return [own] if step > 2 or not appears else []

    assert brakes_from_the_third_step(statuses(MODELS[model], scene))


@pytest.mark.parametrize(
    ("error", "words"), [(OddError, "OddError: no measurement"), (SilentError, "SilentError")]
)
@pytest.mark.parametrize("model", MODELS)
def test_the_warning_of_a_refused_barrier_names_the_class_of_its_error(model, error, words):
    own = Own("own", 1)
    own.error = error
    with pytest.warns(SafetyWarning, match=words):
        statuses(MODELS[model], lambda step: [own] if step > 2 else [])


@pytest.mark.parametrize("model", MODELS)
def test_a_refused_barrier_is_refused_again_whatever_else_changes(model):
    late = Late("late", 1)
    assert brakes_from_the_third_step(
        statuses(MODELS[model], lambda step: [late] if step > 2 else [])
    )


@pytest.mark.parametrize("model", MODELS)
def test_a_scene_is_refused_whose_number_of_barriers_changed_with_it(model):
    limit = SpeedLimit("limit", 1, 1e-3)  # lower than any input satisfies
    found = statuses(
        MODELS[model], lambda step: [limit] if step > 2 else [], alpha1=LinearClassK(1.0)
    )
    assert brakes_from_the_third_step(found)


@pytest.mark.parametrize("error", [RuntimeError, OddError])
def test_a_brake_that_raises_is_replaced_by_the_input_nearest_to_zero(error):
    def brake(x):
        raise error("no brake")

    own = Own("own", 1)
    model = MODELS["planar"]
    reader = lambda env, x, info: [own]  # noqa: E731
    plant = Plant(model, reader, lambda env, x, info: x, period=T, brake=brake)
    env = SafetyFilter(World(model, T, 2.0, (0.0,) * 4), plant=plant)
    env.reset()
    own.error = error
    with pytest.warns(SafetyWarning, match=f"the plant's brake raised {error.__name__}: no brake"):
        _, _, _, _, info = env.step(REST)
    _, _, _, _, info = env.step(REST)
    assert info["safety_filter"]["status"] == FilterStatus.BACKUP
    assert not info["safety_filter"]["u_safe"].any()


JET = Jet(5.0, np.eye(4)[0], np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)
ODD_JETS = {
    "none": None,
    "text": "abc",
    "texts": ("a",) * 6,
    "a number": 3.0,
    "too few": JET[:2],
    "unreadable": Unreadable(),
    "unreadable parts": (Unreadable(),) * 6,
    "tuple with NaN": (np.nan, *JET[1:]),
    "a huge integer": JET._replace(h=10**400),
    "lists": JET._replace(gradient=[1.0, 0.0, 0.0, 0.0]),
}
ODD_JETS |= {
    f"{field}: {name}": JET._replace(**{field: value})
    for field in JET._fields
    for name, value in no_numbers(np.array(getattr(JET, field))).items()
}


class Anything(Barrier):
    """A wall of a user's own, whose jet is given."""

    given = JET

    def jet(self, x, t=0.0):
        return self.given


@pytest.mark.parametrize("uncertainty", [Uncertainty(), Uncertainty(distance=0.1)])
@pytest.mark.parametrize("jet", ODD_JETS)
@pytest.mark.parametrize("model", MODELS)
def test_a_jet_that_is_none_makes_the_robot_brake(model, jet, uncertainty):
    own = Anything("own", 1)

    def scene(step):
        own.given = ODD_JETS[jet] if step > 2 else JET
        return [own]

    assert brakes_from_the_third_step(statuses(MODELS[model], scene, uncertainty=uncertainty))


class Own64(np.ndarray):
    """An array of a user's own class."""


READABLE_JETS = {
    "tuple": tuple(JET),
    "list": list(JET),
    "integers": JET._replace(h=5, gradient=np.array([1, 0, 0, 0])),
    "an array of no axis": JET._replace(h=np.array(5.0)),
    "32 bits": JET._replace(gradient=np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32)),
    "a subclass": JET._replace(gradient=np.array([1.0, 0.0, 0.0, 0.0]).view(Own64)),
    "nothing masked": JET._replace(gradient=np.ma.masked_array([1.0, 0.0, 0.0, 0.0], [False] * 4)),
}


@pytest.mark.parametrize("uncertainty", [Uncertainty(), Uncertainty(distance=0.1)])
@pytest.mark.parametrize("jet", READABLE_JETS)
@pytest.mark.parametrize("model", MODELS)
def test_a_jet_of_real_numbers_is_read_whatever_holds_them(model, jet, uncertainty):
    own = Anything("own", 1)

    def scene(step):
        own.given = READABLE_JETS[jet] if step > 2 else JET
        return [own]

    found = statuses(MODELS[model], scene, uncertainty=uncertainty)
    assert FilterStatus.BACKUP not in found


class Placed(PlanarBarrier):
    """A moving wall of a user's own, each part of which is given."""

    parts = {}  # noqa: RUF012

    def part(self, name, valid):
        value = self.parts.get(name, valid)
        if isinstance(value, Exception):
            raise value
        return value

    @property
    def frame_velocity(self):
        return self.part("frame_velocity", np.array([0.1, 0.0]))

    @property
    def reads_position(self):
        return self.part("reads_position", True)

    def planar_jet(self, q):
        parts = self.part("H", 5.0), self.part("∇H", np.array([-1.0, 0.0]))
        return self.part("planar_jet", (*parts, self.part("∇²H", np.zeros((2, 2)))))

    def core(self, q, reach):
        return self.part("core", Core(3.0, 0.5, True))


ODD_PARTS = {
    "frame_velocity": np.array([0.1, 0.0]),
    "H": np.array(5.0),
    "∇H": np.array([-1.0, 0.0]),
    "∇²H": np.eye(2),
}
ODD_PARTS = {
    (part, name): value
    for part, valid in ODD_PARTS.items()
    for name, value in no_numbers(valid).items()
} | {
    ("frame_velocity", "raises"): OddError(),
    ("reads_position", "raises"): SilentError(),
    ("planar_jet", "raises"): SilentError(),
    ("planar_jet", "none"): None,
    ("planar_jet", "a number"): 5.0,
}


# `anew`: whether the list of barriers changes at each step. Only then do rows of other models than
# the planar one read `reads_position`.
ODD_PLACES = [
    (model, part, name, anew)
    for model, (part, name), anew in itertools.product(MODELS, ODD_PARTS, (False, True))
    if part != "reads_position" or model == "planar" or anew
]


@pytest.mark.parametrize(("model", "part", "name", "anew"), ODD_PLACES)
def test_an_unreadable_part_of_a_moving_barrier_makes_the_robot_brake(model, part, name, anew):
    own = Placed("own", 1)

    def scene(step):
        own.parts = {part: ODD_PARTS[part, name]} if step > 2 else {}
        return [own, *([Disc("other", 1, (30.0, step), 0.5)] if anew else [])]

    assert brakes_from_the_third_step(statuses(MODELS[model], scene))


CORES = {
    "complex": Core(3.0 + 1j, 0.5, True),
    "text": Core(3.0, "0.5", True),
    "no core": (3.0, 0.5),
    "raises": OddError(),
}


@pytest.mark.parametrize("core", CORES)
def test_an_unreadable_core_makes_the_robot_brake(core):
    own = Placed("own", 1)

    def scene(step):
        own.parts = {"core": CORES[core]} if step > 2 else {}
        return [own]

    assert brakes_from_the_third_step(statuses(MODELS["planar"], scene))


F, G = np.array([0.1, 0.0, 0.0, 0.0]), np.eye(4, 2, k=-2)


class Given(ReducedOrderModel):
    """A model of a user's own, whose f, g and ∂f/∂x are given."""

    n, n_u, velocity_at = 4, 2, 2
    parts = {}  # noqa: RUF012

    def part(self, name, x):
        value = self.parts.get(name, {"f": F, "g": G, "f_jacobian": np.eye(4, k=2)}[name])
        if isinstance(value, Exception):
            raise value
        return np.concatenate([x[2:], [0.0, 0.0]]) if value is F else value

    def f(self, x):
        return self.part("f", x)

    def g(self, x):
        return self.part("g", x)

    def f_jacobian(self, x):
        return self.part("f_jacobian", x)


ODD_TERMS = {
    (part, name): value
    for part, valid in {"f": F, "g": G, "f_jacobian": np.eye(4, k=2)}.items()
    for name, value in (no_numbers(valid) | {"raises": SilentError()}).items()
}
ODD_TERMS["g", "transposed"] = G.T


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(("part", "name"), ODD_TERMS)
def test_a_model_without_real_numbers_makes_the_robot_brake(part, name, own):
    model = Given()

    def scene(step):
        model.parts = {part: ODD_TERMS[part, name]} if step > 2 else {}
        return [Anything("own", 1)] if own else []

    # a world moves by its own model
    assert brakes_from_the_third_step(statuses(model, scene, world=MODELS["planar"]))


@pytest.mark.parametrize(("part", "name"), [key for key in ODD_TERMS if key[0] != "f_jacobian"])
def test_a_model_of_functions_without_real_numbers_makes_the_robot_brake(part, name):
    given = Given()
    model = ControlAffine(given.f, given.g, 4, 2, 2)

    def scene(step):
        given.parts = {part: ODD_TERMS[part, name]} if step > 2 else {}
        return []

    assert brakes_from_the_third_step(statuses(model, scene, world=MODELS["planar"]))


def reports(fields, changed, **options):
    """The reports of a reset and six steps, where readers return `changed` from the third step."""
    now = {"barriers": [Disc("disc", 1, (3.0, 3.0), 0.5)], "state": None} | fields

    def reader(name):
        return lambda env, x, info: x if name == "state" and now[name] is None else now[name]

    model = MODELS["planar"]
    plant = Plant(model, **{name: reader(name) for name in now}, period=T)
    env = SafetyFilter(World(model, T, 2.0, (0.0,) * 4), plant=plant, **options)
    found = [env.reset()[1]]
    for step in range(1, 7):
        now |= changed if step > 2 else {}
        found.append(env.step(REST)[4])
    env.reset()  # the reader is as bad at a later reset
    return [info["safety_filter"] for info in found]


class Elusive(Unreadable):
    """A goal that cannot be copied or compared, and whose numbers can be read."""

    def __getattr__(self, name):
        raise AttributeError(name)

    def __array__(self, *_, **__):
        return np.array([5.0, 0.0])


GOALS = {"goal": np.array([5.0, 0.0]), "extent": np.array([(-9.0, -9.0), (9.0, 9.0)])}
ODD_GOALS = {
    (field, name): value
    for field, valid in GOALS.items()
    for name, value in (no_numbers(1.1 * valid) | {"generator": iter(valid)}).items()
    if not (field == "extent" and value is None)  # which leaves the extent to guidance
    if name != "one more axis"  # which is that of one plant among N
}


@pytest.mark.parametrize(("field", "name"), ODD_GOALS)
def test_an_unreadable_goal_or_extent_makes_the_robot_brake(field, name):
    found = reports(GOALS, {field: ODD_GOALS[field, name]}, guidance="geodesic")
    reasons = [int(one["reason"]) for one in found]
    assert reasons == [0] * 3 + [Reason.GOAL] * 4
    assert [one["status"] == FilterStatus.BACKUP for one in found] == [False] * 3 + [True] * 4


def test_a_goal_that_cannot_be_copied_is_followed_by_its_numbers():
    found = reports(GOALS, {"goal": Elusive()}, guidance="geodesic")
    assert not any(int(one["reason"]) for one in found)


VERDICTS = {
    "text": "yes",
    "unreadable": Unreadable(),
    "no reason": Judged(Coverage.COVERED, None),
    "another number": 7,
    "a reason of text": Judged(Coverage.COVERED, "yes"),
    "a reason without number": Judged(Coverage.SCENE, 99),
}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_an_unreadable_verdict_covers_nothing_and_the_warning_names_it(verdict):
    with pytest.warns(SafetyWarning, match=r"reader of the covered.*covered is 0"):
        found = reports({"covered": Coverage.COVERED}, {"covered": VERDICTS[verdict]})
    assert [int(one["covered"]) for one in found[3:]] == [0] * 4
    assert not any(int(one["reason"]) for one in found)
    with pytest.raises(InvalidInputError, match="covered"):
        reports({"covered": VERDICTS[verdict]}, {})


def test_a_declared_value_that_cannot_be_read_covers_nothing_and_is_named():
    certificate = made({"mass": 1.0})
    reader = CertificateCoverage(certificate, {}, lambda *_: {"mass": Unreadable()})
    verdict = reader(None, None, {})
    assert (verdict.covered, verdict.covered_by) == (Coverage.OUTSIDE, CoveredBy.CERTIFICATE)
    assert "OddError" in verdict.reasons[0]
    assert reader._replace(declared={"mass": 1.0})(None, None, {}).covered == Coverage.COVERED


@pytest.mark.parametrize("error", [RuntimeError("no motor"), SilentError()])
@pytest.mark.parametrize("name", ["to_action", "from_action"])
def test_a_conversion_of_actions_that_raises_is_an_error_before_the_environment_is_stepped(
    name, error
):
    fails = []

    def convert(value):
        if fails:
            raise error
        return value

    conversions = {"to_action": lambda u: u, "from_action": lambda u: u} | {name: convert}
    model = MODELS["planar"]
    reader = lambda env, x, info: []  # noqa: E731
    plant = Plant(
        model, reader, lambda env, x, info: x, input_set=Box.symmetric(2.0), period=T, **conversions
    )
    world = World(model, T, 2.0, (0.0,) * 4)
    env = SafetyFilter(world, plant=plant)
    env.reset()
    env.step(REST)
    fails.append(True)
    with pytest.raises(InvalidInputError, match=f"{name} raised {type(error).__name__}"):
        env.step(REST)
    assert len(world.applied) == 1
    fails.clear()
    _, _, _, _, info = env.step(REST)
    assert info["safety_filter"]["status"] != FilterStatus.BACKUP


class Worlds(VectorEnv):
    """Three planar double integrators, of which the second's episode ends at the third step."""

    def __init__(self, mode):
        self.num_envs, self.metadata = 3, {"autoreset_mode": mode}
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float64)
        self.single_action_space = gym.spaces.Box(-2.0, 2.0, (2,), np.float64)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, 3)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, 3)

    def reset(self, *, seed=None, options=None):
        self.steps, self.x = 0, np.zeros((3, 4))
        return self.x.copy(), {}

    def step(self, actions):
        self.steps += 1
        self.x = MODELS["planar"].steps_of(self.x, actions, T)
        ended, infos = np.arange(3) == 1 if self.steps == 3 else np.zeros(3, dtype=bool), {}
        if self.is_new and self.steps == self.first:
            self.x[1] = 0.0
        if ended.any() and self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP:
            infos = {"final_info": {}, "_final_info": ended}
        return self.x.copy(), np.zeros(3), ended, np.zeros(3, dtype=bool), infos

    @property
    def first(self):
        """The step in which the second episode begins anew."""
        return 3 + (self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP)

    @property
    def is_new(self):
        return self.steps >= self.first


INVALID_SCENES = {
    "a limit below any input": [SpeedLimit("limit", 1, 1e-3)],
    "no barrier": [3],
    "no list": None,
    "a barrier whose code fails": [Placed("own", 1)],
}


@pytest.mark.parametrize("scene", INVALID_SCENES)
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_invalid_barriers_of_an_episode_that_begins_within_a_step_brake_until_they_are_valid(
    mode, scene
):
    valid, worlds, repaired = [Disc("disc", 1, (20.0, 0.3), 0.5)], Worlds(mode), []
    if scene == "a barrier whose code fails":
        INVALID_SCENES[scene][0].parts = {"planar_jet": SilentError()}

    def barriers(env, x, info):
        is_invalid = env.is_new and not repaired
        return [valid, INVALID_SCENES[scene] if is_invalid else valid, valid]

    plant = Plant(MODELS["planar"], barriers, lambda env, x, info: x, period=T)
    env = VectorSafetyFilter(worlds, plant=plant)
    env.reset()
    reasons = []
    for step in range(1, 8):
        repaired += [True] if step > 5 else []
        _, _, _, _, info = env.step(np.full((3, 2), 0.5))
        reasons.append(info["safety_filter"]["reason"].tolist())
    of_all = [Reason.BARRIERS] * 3  # the lists of all plants are read together
    of_one = [0, int(Reason.BARRIERS), 0]
    at_begin = worlds.first - 1
    assert reasons[:at_begin] == [[0] * 3] * at_begin
    assert reasons[at_begin] == of_one
    assert reasons[at_begin + 1 : 5] == [of_all] * (4 - at_begin)
    assert reasons[5:] == [[0] * 3] * 2


def subclass(base, **methods):
    """A user's subclass of a class that compiled code reads by its numbers."""
    return type("Own", (base,), methods)


@pytest.mark.parametrize("method", ["support", "project", "vertices"])
@pytest.mark.parametrize("base", [Box, Ball])
def test_an_input_set_with_a_method_that_no_compiled_code_calls_is_refused(base, method):
    arguments = ([-2.0, -2.0], [2.0, 2.0]) if base is Box else (2.0,)

    def plant(**methods):
        inputs = subclass(base, **methods)(*arguments)
        reader = lambda env, x, info: []  # noqa: E731
        return Plant(MODELS["planar"], reader, lambda env, x, info: x, input_set=inputs)

    assert plant().input_set is not None
    with pytest.raises(InvalidInputError, match=f"its own {method}"):
        plant(**{method: lambda self, *_: None})


@pytest.mark.parametrize("method", ["__call__", "parameters", "inverse", "derivative"])
@pytest.mark.parametrize("base", [LinearClassK, LogClassK])
def test_a_class_k_function_with_a_method_that_no_compiled_code_calls_is_refused(base, method):
    arguments = (1.0,) if base is LinearClassK else ()
    own = subclass(base)(*arguments)
    assert class_k.make(own) is own
    with pytest.raises(InvalidInputError, match=f"its own {method}"):
        class_k.make(subclass(base, **{method: lambda self, *_: None})(*arguments))
