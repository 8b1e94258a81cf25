"""The walking robot detects a plant that was not declared."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym._core import trunk_velocity
from hcbf_gym.arrays import packed
from hcbf_gym.envs.a1_plant import watch_bounds
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.evaluation import attacks
from hcbf_gym.locomotion import records, watch
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.watch import Fault, Watch, WatchBounds
from hcbf_gym.robots.reader import read_robot

ROBOT = read_robot()
LEGS = RobotModel(ROBOT).legs
TICKS = 20  # between two judgements
BOUNDS = WatchBounds(slip=0.1, lag=0.2, lift=1.0, delay=0.004)
STANDING, SWINGING = np.ones(4, dtype=bool), np.zeros(4, dtype=bool)


def make_watch() -> Watch:
    return Watch(LEGS, ROBOT.foot_radius, 0.002, BOUNDS)


def at_rest() -> np.ndarray:
    vector = np.zeros(41)
    vector[2], vector[3] = ROBOT.home_height, 1.0
    vector[7:19] = ROBOT.home_joints
    vector[37:] = 1.0
    return vector


def attacked(name, seconds, change=None, **options):
    """Return the greatest signals (3,) and every fault of an attack on an unfiltered robot."""
    env = gym.make("HCBF-A1Regions-v0", scenario="random", **options)
    _, info = env.reset(seed=7)
    if change is not None:
        change(env.unwrapped.simulation)
    attack, signals, faults = attacks.make(name, 7), [], set()
    for _ in range(round(seconds / 0.02)):
        _, _, ended, _, info = env.step(0.6 * attack.act(attacks.observe(env)))
        signals.append([info["slip"], info["lag"], info["lift"]])
        faults.add(env.unwrapped.drive.watch.fault)
        if ended:
            break
    env.close()
    return np.max(signals, axis=0), faults


def later(seconds):
    def change(simulation):
        for _ in range(round(seconds / simulation.model.opt.timestep)):
            simulation._delayed.append(np.zeros(12))

    return change


def smooth_floor(simulation):
    simulation.model.geom_friction[simulation._feet, 0] = 0.3


def weak_motors(simulation):
    simulation.conditions = simulation.conditions._replace(motor_strength=0.8)


def test_the_declared_plant_shows_no_slip_no_lag_and_no_lift():
    (slip, lag, lift), faults = attacked("bang-bang", 3.0)
    assert slip < 0.04
    assert lag <= 0.0
    assert lift < 0.5
    assert faults == {Fault.NONE}


@pytest.mark.parametrize(
    ("change", "fault", "declared"),
    [
        (smooth_floor, Fault.SLIP, {"floor_friction": 0.3}),
        (later(0.014), Fault.LAG, {"delay": 0.016}),
        (weak_motors, Fault.LIFT, {"motor_strength": 0.8}),
    ],
)
@pytest.mark.filterwarnings("ignore:.*is lowered:hcbf_gym.errors.LoweredWarning")  # floor of .3
def test_a_plant_is_a_fault_unless_it_is_declared(change, fault, declared):
    assert fault in attacked("edge", 3.0, change)[1]
    assert fault not in attacked("edge", 1.5, randomization=declared)[1]


def test_infos_carry_the_signals_from_the_reset_on():
    env = gym.make("HCBF-A1Regions-v0")
    _, at_reset = env.reset(seed=0)
    _, _, _, _, info = env.step(np.zeros(2, dtype=np.float32))
    for name in ("slip", "lag", "lift"):
        assert at_reset[name] == 0.0
        assert isinstance(at_reset[name], np.float64)
        assert isinstance(info[name], np.float64)
    env.close()


def test_slip_is_the_speed_at_which_planned_feet_move_over_the_ground():
    seen, moving = make_watch(), at_rest()
    moving[19:21] = 0.3, 0.4
    for step in range(20):
        for _ in range(TICKS):
            seen.tick(moving if step >= 8 else at_rest(), np.zeros(12), STANDING)
        seen.judge(0.0)
        if step == 7:
            assert seen.slip == pytest.approx(0.0, abs=1e-12)
            assert seen.fault == Fault.NONE
    assert seen.slip == pytest.approx(0.5)
    assert seen.fault == Fault.SLIP
    seen.reset()
    for _ in range(25 * TICKS):
        seen.tick(moving, np.zeros(12), SWINGING)
        if len(seen._states) == TICKS:
            seen.judge(0.0)
    assert seen.slip == 0.0


@pytest.mark.parametrize("delay", range(8))
def test_lag_separates_declared_delays_from_others(delay):
    rng, seen, jerk = np.random.default_rng(delay), make_watch(), np.zeros((3, 12))
    torques = rng.normal(size=(320, 12)).cumsum(axis=0)
    for k in range(TICKS, 16 * TICKS):
        change = torques[k - 1 - delay] - torques[k - 2 - delay]
        jerk[:2] = jerk[1:]
        jerk[2] = change + 2.0 * jerk[1] - jerk[0]
        state = at_rest()
        state[25:37] = jerk[2]
        seen.tick(state, torques[k], SWINGING)
        if k % TICKS == TICKS - 1:
            seen.judge(0.0)
    assert (seen.lag > 0.5) == (delay > 2)  # 4 ms are declared
    assert (seen.lag < -0.5) == (delay <= 2)
    assert (seen.fault == Fault.LAG) == (delay > 2)


def test_joints_that_rest_show_no_lag():
    seen = make_watch()
    for _ in range(25):
        for _ in range(TICKS):
            seen.tick(at_rest(), np.zeros(12), SWINGING)
        seen.judge(0.0)
    assert seen.lag == 0.0
    assert seen.fault == Fault.NONE


def test_lift_is_the_mean_of_the_window():
    seen = make_watch()
    for step in range(30):
        for _ in range(TICKS):
            seen.tick(at_rest(), np.zeros(12), STANDING)
        seen.judge(float(step))
    assert seen.lift == pytest.approx(np.mean(np.arange(30.0 - watch.WINDOW, 30.0)))
    assert seen.fault == Fault.LIFT


def sums_in_numpy(states, torques, stances, lift):
    """Return (WINDOW, …) the sums of ticks since a reset, as the core has them."""
    delays, sums, legs = 13, [], packed(LEGS, records.LEGS)
    rates = np.vstack([np.zeros((2, 12)), states[:, 25:37]])
    bends = rates[2:] - 2.0 * rates[1:-1] + rates[:-2]
    changes = np.diff(np.vstack([np.zeros((delays + 1, 12)), torques]), axis=0)
    touched = np.zeros(4)
    for k, (state, stance) in enumerate(zip(states, stances, strict=True)):
        if k % TICKS == 0:
            sums.append(np.zeros(4 + 2 * delays))
            sums[-1][2] = lift
        row, swings = sums[-1], np.repeat(~stance, 3)
        touched = np.where(state[37:] > 0.0, touched + 1, 0)
        late = changes[k : k + delays][::-1]
        row[3] += (bends[k, swings] ** 2).sum()
        row[4 : 4 + delays] += (late * bends[k])[:, swings].sum(axis=1)
        row[4 + delays :] += (late**2)[:, swings].sum(axis=1)
        if k % 5 == 4:
            for foot in np.flatnonzero(stance & (touched >= 5)):
                shown, _ = trunk_velocity(legs, ROBOT.foot_radius, foot, state)
                row[0] += np.hypot(*(state[19:21] - shown))
                row[1] += 1.0
    return np.array(sums)


def test_the_sums_equal_those_in_numpy_on_recorded_ticks():
    env = gym.make("HCBF-A1Regions-v0")
    env.reset(seed=0)
    drive, seen = env.unwrapped.drive, []

    class Recorder(Watch):
        def tick(self, state, torque, stance):
            seen.append((state, torque, stance.copy()))
            super().tick(state, torque, stance)

        def judge(self, lift):
            super().judge(0.1)

    drive.watch = Recorder(LEGS, ROBOT.foot_radius, 0.002, BOUNDS)
    for _ in range(2 * watch.WINDOW):
        env.step(np.array([2.0, 1.0], dtype=np.float32))
    env.close()
    sums = drive.watch._compiled.sums
    expected = sums_in_numpy(*(np.array(part) for part in zip(*seen, strict=True)), 0.1)
    np.testing.assert_allclose(sums, expected, rtol=1e-9, atol=1e-12)
    assert (sums != 0.0).any(axis=0).all()


def test_bounds_grow_with_what_is_declared_and_never_shrink():
    nominal = watch_bounds(Randomization(), "flat", False, 12.0)
    stronger = watch_bounds(Randomization(motor_strength=(1.2, 1.2)), "flat", False, 12.0)
    assert stronger == nominal
    loaded = watch_bounds(Randomization(payload=(0.0, 3.0)), "flat", False, 12.0)
    assert loaded.lift == pytest.approx(nominal.lift + 9.81 * 0.25)
    late = watch_bounds(Randomization(delay=(0.0, 0.008)), "flat", False, 12.0)
    assert late.delay == 0.008
    assert watch_bounds(Randomization(delay=(0.0, 0.0)), "flat", False, 12.0) == nominal
    for bounds in (
        watch_bounds(Randomization(), "rough", False, 12.0),
        watch_bounds(Randomization(), "flat", True, 12.0),
        watch_bounds(Randomization(sensor_noise=(0.0, 1.0)), "flat", False, 12.0),
        late,
    ):
        assert bounds.slip > nominal.slip
