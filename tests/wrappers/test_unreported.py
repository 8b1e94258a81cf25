"""What infos of a vector do not report is NaN for readers; a partial reset leaves the others."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import hcbf_gym
from hcbf_gym import Estimate, models
from hcbf_gym.barriers import HalfPlane
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import VectorSafetyFilter
from hcbf_gym.wrappers.infos import joined, reported
from tests.pairs import pairwise

T, N = 0.05, 3


class Robot(gym.Env):
    """A point that reports in its infos where it is, where it is to go, and what it sees."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float64)
    action_space = gym.spaces.Box(-2.0, 2.0, (2,), np.float64)
    dtype, form = np.float64, "array"
    silent = ()

    def _info(self):
        x = self.x.astype(self.dtype)
        goal, wall = np.array([3.0, 1.0]), np.array([1.0, 0.0, -6.0])
        extent = np.array([[-6.0, -6.0], [6.0, 6.0]])
        info = {"state": x, "goal": goal, "wall": wall, "extent": extent}
        info = {key: value for key, value in info.items() if key not in self.silent}
        if self.form == "dict":
            info = {"seen": info}
        elif self.form == "object":
            info = {key: Box(value) for key, value in info.items()}
        return info | {"always": 1}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.steps = np.array([1.0, 1.0, 0.5, 0.0]), 0
        return self.x.copy(), self._info()

    def step(self, action):
        self.x[:2] += T * self.x[2:] + 0.5 * T**2 * action
        self.x[2:] += T * action
        self.steps += 1
        return self.x.copy(), 0.0, self.steps == 12, False, self._info()


class Box(list):
    """An object of no type that Gymnasium knows, which holds an array."""

    def __init__(self, value):
        super().__init__(np.asarray(value).ravel().tolist())


def entry(info, key, shape):
    """(N, …) an entry of the infos of any form."""
    value = info["seen"][key] if "seen" in info else info[key]
    rows = [np.asarray(one, dtype=np.float64) for one in value]
    return np.array([row.reshape(shape) for row in rows])


def barriers(_, __, info):
    walls = entry(info, "wall", (3,))
    if not np.isfinite(walls).all():  # no barrier is made of NaN
        raise RuntimeError("no wall is known")
    return [[HalfPlane("wall", 1, tuple(w[:2]), w[2])] for w in walls]


PLANT = {
    "state": lambda _, __, info: Estimate(entry(info, "state", (4,))),
    "goal": lambda _, __, info: entry(info, "goal", (2,)),
    "extent": lambda _, __, info: entry(info, "extent", (2, 2)),
    "barriers": barriers,
}


def made(mode, dtype=np.float64, form="array", guided=True):
    class One(Robot):
        pass

    One.dtype, One.form = dtype, form
    robots = [One() for _ in range(N)]
    env = SyncVectorEnv([lambda one=one: one for one in robots], autoreset_mode=mode)
    plant = hcbf_gym.Plant(models.DoubleIntegrator(), period=T, **PLANT)
    return robots, VectorSafetyFilter(env, plant=plant, guidance="geodesic" if guided else None)


@pytest.mark.parametrize(
    ("key", "mode", "dtype", "form"),
    pairwise(
        ("state", "goal"), AutoresetMode, (np.float64, np.float32, np.int64),
        ("array", "dict", "object"),
    ),
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_a_plant_that_does_not_report_brakes_alone(key, mode, dtype, form):
    robots, safe = made(mode, dtype, form)
    safe.reset(seed=0)
    wanted = np.tile([0.4, 0.2], (N, 1))
    reasons = {"state": Reason.STATE, "goal": Reason.GOAL}
    for k in range(9):
        robots[1].silent = (key,) if k in (3, 4) else ()
        _, _, _, _, info = safe.step(wanted)
        if k in (4, 5):  # one step later: readers look at the infos before the action
            found = info["safety_filter"]
            assert found["reason"].tolist() == [0, reasons[key], 0]
            assert (found["status"] == FilterStatus.BACKUP).tolist() == [False, True, False]
        elif k < 4:
            assert not info["safety_filter"]["reason"].any()


@pytest.mark.parametrize("key", ["wall", "extent"])
def test_what_is_shared_and_not_reported_is_never_zero(key):
    robots, safe = made(AutoresetMode.NEXT_STEP)
    safe.reset(seed=0)
    wanted = np.zeros((N, 2))
    safe.step(wanted)
    robots[1].silent = (key,)
    safe.step(wanted)
    with pytest.warns(SafetyWarning):
        report = safe.step(wanted)[4]["safety_filter"]
    reason = Reason.BARRIERS if key == "wall" else Reason.GOAL
    assert (report["reason"] == reason).all()


def test_a_partial_reset_leaves_what_others_reported():
    robots, safe = made(AutoresetMode.DISABLED, guided=False)
    safe.reset(seed=0)
    wanted = np.tile([0.4, 0.2], (N, 1))
    for _ in range(3):
        safe.step(wanted)
    begins = np.array([False, True, False])
    _, info = safe.reset(options={"reset_mask": begins})
    assert info["_safety_filter"].tolist() == begins.tolist()
    before = [robot.x.copy() for robot in robots]
    report = safe.step(wanted)[4]["safety_filter"]
    assert not report["reason"].any()  # the others were not reset, and none is unknown
    np.testing.assert_allclose(report["h"][:, 0], [x[0] + 6.0 for x in before])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.array([1.0, 0.0]), [1.0, np.nan]),
        (np.array([1, 0]), [1.0, np.nan]),
        (np.array([True, False]), [1.0, np.nan]),
        (np.array([[1, 2], [0, 0]], dtype=np.int8), [[1.0, 2.0], [np.nan, np.nan]]),
        (np.array([[1, 2], [0, 0]], dtype=np.float32), [[1.0, 2.0], [np.nan, np.nan]]),
        (np.array([np.zeros(2), None], dtype=object), [[0.0, 0.0], [np.nan, np.nan]]),
        (np.array([7.0, None], dtype=object), [7.0, np.nan]),
        ([5, 0], [5.0, np.nan]),
    ],
)
def test_every_type_has_nan(value, expected):
    mask = np.array([True, False])
    for infos in (
        {"key": value, "_key": mask},
        {"outer": {"key": value, "_key": mask}, "_outer": mask},
        {"outer": {"key": value}, "_outer": mask},
    ):
        found = reported(infos)
        one = found["outer"]["key"] if "outer" in found else found["key"]
        for got, wanted in zip(one, expected, strict=True):
            np.testing.assert_array_equal(np.asarray(got, dtype=np.float64), wanted)
    all_of_them = {"key": value, "_key": np.array([True, True]), "plain": 3}
    assert reported(all_of_them)["key"] is value
    texts = reported({"key": np.array(["a", ""]), "_key": mask})["key"]
    assert texts[0] == "a"
    assert np.isnan(texts[1])


def test_infos_of_a_partial_reset_are_joined():
    begins = np.array([True, False])
    before = {"x": np.array([1.0, 2.0]), "deep": {"y": np.array([3, 4])}, "gone": np.ones((2, 2))}
    found = joined({"x": np.array([9.0, np.nan]), "deep": {"y": np.array([8.0, np.nan])}}, before,
                   begins)  # fmt: skip
    np.testing.assert_array_equal(found["x"], [9.0, 2.0])
    np.testing.assert_array_equal(found["deep"]["y"], [8.0, 4.0])
    np.testing.assert_array_equal(found["gone"], [[np.nan, np.nan], [1.0, 1.0]])
