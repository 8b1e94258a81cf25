"""Pose and twist are compared at the time of their measurement, however late they come."""

import numpy as np
import pytest

from hcbf_gym.models import Reason
from hcbf_robots import Command, Response
from hcbf_robots.walkers.motion_monitor import MotionMonitor
from tests.online.test_own_loop import EXACT, FAR, PERIOD, VelocityFilter

pytestmark = pytest.mark.filterwarnings("ignore:.*")
ANYTHING = Response(deviation=1e6)
"""Of a robot whose commands predict nothing."""
FAULTS = {
    "none": lambda place, velocity: (place, velocity),
    "dead": lambda place, velocity: (0.0 * place, velocity),
    "halved": lambda place, velocity: (0.5 * place, velocity),
    "reversed": lambda place, velocity: (place, -velocity),
    "doubled": lambda place, velocity: (place, 2.0 * velocity),
}


def monitor_of(hardest):
    """Return a monitor of the twist alone."""
    return MotionMonitor(Command(1.0, 1.0, sideways=1.0), ANYTHING, 1.0, PERIOD, hardest)


def observed(monitor, place, velocity, time):
    """Return whether a sample alarms."""
    return monitor.observe(np.array([*place, 0.0]), velocity, time) == Reason.MOTION


def shuttle(seconds, hardest=3.0, dt=0.01):
    """Return times, places and velocities (n, 2) of a robot that drives to and fro, and aside."""
    time = np.arange(0.0, seconds, dt)
    wanted = np.stack([np.sign(np.sin(2.0 * time)), 0.6 * np.sign(np.sin(3.1 * time))], axis=1)
    velocity = np.zeros((len(time), 2))
    for k in range(1, len(time)):
        off = wanted[k] - velocity[k - 1]
        velocity[k] = velocity[k - 1] + np.clip(off, -hardest * dt, hardest * dt)
    place = np.vstack([[0.0, 0.0], np.cumsum(0.5 * dt * (velocity[1:] + velocity[:-1]), axis=0)])
    return time, place, velocity


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(("every", "lost"), [(2, 0.0), (5, 0.0), (10, 0.0), (5, 0.4), (10, 0.4)])
def test_what_is_measured_at_any_rate_is_compared_with_its_own_twist(fault, every, lost):
    rng, alarmed = np.random.default_rng(0), False
    monitor = monitor_of(4.3)
    time, place, velocity = shuttle(20.0)
    for k in range(0, len(time), every):
        if rng.random() >= lost:
            at, moves = FAULTS[fault](place[k], velocity[k])
            alarmed |= observed(monitor, at, moves, time[k])
    assert alarmed == (fault != "none")


@pytest.mark.parametrize("late", [0.0, 0.1, 0.19, 0.3])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_lateness_that_stays_is_no_alarm_and_hides_none(late, fault):
    safe = VelocityFilter(EXACT, FAR, period=PERIOD, max_age=0.35)
    given, place, past, reasons = np.zeros(3), np.zeros(2), [], []
    for k in range(400):
        now = 7.0 + PERIOD * k
        past.append((now, place, given[:2]))
        stamp, *known = next((p for p in reversed(past) if p[0] <= now - late + 1e-9), past[0])
        at, moves = FAULTS[fault](*known)
        wanted = (np.sign(np.sin(2.0 * now)), 0.6 * np.sign(np.sin(3.1 * now)), 0.0)
        pose, twist = (*at, 0.0), (*moves, 0.0)
        given, report = safe.step(wanted, pose, twist, stamp, now)
        reasons.append(int(report["reason"]))
        place = place + PERIOD * given[:2]
    if fault == "none":
        assert not any(reasons)
    else:
        assert max(reasons) in (Reason.MOTION, Reason.RESPONSE)


def test_it_starts_anew_after_a_gap_and_ignores_what_is_older():
    monitor = monitor_of(4.0)
    still = np.zeros(2), np.array([1.0, 0.0])
    assert not any(observed(monitor, *still, 1.0) for _ in range(20))
    assert not any(observed(monitor, *still, 1.0 - 0.01 * k) for k in range(20))
    assert not any(observed(monitor, *still, 2.0 + 0.7 * k) for k in range(20))
    assert any(observed(monitor, *still, 30.0 + 0.05 * k) for k in range(20))


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02])
def test_white_noise_of_positions_is_no_motion_and_is_averaged(noise):
    time, place, velocity = shuttle(60.0)
    rng, off = np.random.default_rng(1), []
    monitor = monitor_of(4.3)
    for k in range(0, len(time), 5):
        seen = place[k] + noise * rng.normal(size=2)
        assert not observed(monitor, seen, velocity[k], time[k])
        off.append(np.linalg.norm(monitor._notes[0]["average"] - place[k]))
    later = np.array(off[200:])
    assert np.sqrt(np.mean(later**2) / 2.0) <= 0.45 * noise + 1e-3
    assert 0.1 * noise <= monitor._notes[0]["deviation"] <= 0.45 * noise + 1e-3
