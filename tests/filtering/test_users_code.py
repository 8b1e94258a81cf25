"""A user's own code may raise anything, and a refused barrier stays refused: the robot brakes."""

import numpy as np
import pytest

from hcbf_gym import Plant
from hcbf_gym.barriers import Barrier, Disc, Jet, LinearClassK, SpeedLimit
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models import DoubleIntegrator
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter
from tests.worlds import World

MODELS = {"planar": DoubleIntegrator(), "with drag": DoubleIntegrator(drag=0.5)}
T, REST = 0.05, np.zeros(2)
pytestmark = pytest.mark.filterwarnings(
    "ignore::hcbf_gym.errors.SafetyWarning", "ignore:safety filter:UserWarning"
)


class OddError(Exception):
    """Derives from no class that reading raises."""


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


def statuses(model, scene_at, steps=6, **options):
    """The status of steps whose barriers are a disc that moves on, and those of `scene_at`."""
    step = [0]

    def barriers(env, x, info):
        return [Disc("disc", 1, (20.0 + 0.001 * step[0], 0.3), 0.5), *scene_at(step[0])]

    plant = Plant(model, barriers, lambda env, x, info: x, period=T)
    env = SafetyFilter(World(model, T, 2.0, (0.0,) * 4), plant=plant, **options)
    env.reset()
    found = []
    for step[0] in range(1, steps + 1):
        _, _, _, _, info = env.step(REST)
        found.append(int(info["safety_filter"]["status"]))
    return found


def brakes_from_the_third_step(found):
    return [status == FilterStatus.BACKUP for status in found] == [False] * 2 + [True] * 4


@pytest.mark.parametrize("error", [RuntimeError, ValueError, OddError, OSError])
@pytest.mark.parametrize("appears", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_a_barrier_that_raises_anything_makes_the_robot_brake(model, appears, error):
    own = Own("own", 1)

    def scene(step):
        own.error = error if step > 2 else None
        return [own] if step > 2 or not appears else []

    assert brakes_from_the_third_step(statuses(MODELS[model], scene))


@pytest.mark.parametrize("model", MODELS)
def test_the_warning_of_a_refused_barrier_names_the_class_of_its_error(model):
    own = Own("own", 1)
    own.error = OddError
    with pytest.warns(SafetyWarning, match="OddError: no measurement"):
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
