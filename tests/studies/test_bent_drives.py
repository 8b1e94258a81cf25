"""Logs whose numbers fit together and say something wrong: refused in words."""

import math

import numpy as np
import pytest

from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command
from hcbf_robots.identification.log import identify_log
from tests.studies import drives

STEP = 0.02


def driven(command, lag, delay, seed=0):
    """Return (n, 10) time, command, pose and twist of a robot with a lag of first order."""
    rng, limits = np.random.default_rng(seed), command.limits
    plan = []
    for k in range(len(limits)):
        for sign in (1.0, -1.0):
            plan += [(3.0, sign * limits * np.eye(len(limits))[k]), (2.0, 0.0 * limits)]
    plan += [(1.0, 0.8 * limits * rng.uniform(-1.0, 1.0, len(limits))) for _ in range(20)]
    told = np.concatenate([np.tile(one, (round(held / STEP), 1)) for held, one in plan])
    if len(limits) == 2:
        told = np.column_stack([told[:, 0], np.zeros(len(told)), told[:, 1]])
    pose, twist, rows = np.zeros(3), np.zeros(3), []
    for k, now in enumerate(told):
        rows.append([STEP * k, *now, *pose, *twist])
        late = told[max(0, k - round(delay / STEP))]
        twist = twist + (1.0 - math.exp(-STEP / lag)) * (late - twist)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        moved = [cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1], twist[2]]
        pose = pose + STEP * np.array(moved)
    return np.array(rows)


def identified(folder, rows, command, *, twist=True, late=0.0, seed=0):
    """Return what a log shows; `late` is by how much commands are stamped after they were given."""
    lines = [list(line) for line in drives.recorded(rows, seed)]
    for line in lines:
        if line[1] is not None:
            line[0] += late
        if not twist:
            line[7:] = [None] * len(line[7:])
    lines.sort(key=lambda line: line[0])
    file = drives.write(folder / "drive.csv", lines, command.sideways is None)
    return identify_log(file, command)[0].response


CART, HOLONOMIC = Command(0.5, 1.5, look_ahead=0.2), Command(0.8, 1.5, sideways=0.8)


@pytest.mark.parametrize("command", [CART, HOLONOMIC], ids=["cart", "holonomic"])
@pytest.mark.parametrize(("lag", "delay", "late"), [
    (0.15, 0.06, 0.2), (0.3, 0.1, 0.3), (0.3, 0.1, 0.38), (0.2, 0.2, 0.38), (0.1, 0.02, 0.2),
])  # fmt: skip
def test_commands_that_are_stamped_late_do_not_hide_in_the_lag(tmp_path, command, lag, delay, late):
    rows = driven(command, lag, delay)
    found = identified(tmp_path, rows, command)
    assert found.follows == pytest.approx(lag + delay, rel=0.2, abs=0.03)
    with pytest.raises(InvalidInputError, match="expected one clock for commands and measurements"):
        identified(tmp_path, rows, command, late=late)


@pytest.mark.parametrize("off", [0.18, -0.5, 0.8, "mirrored"])
def test_a_pose_that_slides_is_not_that_of_a_differential_drive(tmp_path, off):
    rows = driven(CART, 0.1, 0.04)
    assert identified(tmp_path, rows, CART, twist=False).gain[0] == pytest.approx(1.0, abs=0.05)
    if off == "mirrored":
        rows[:, 5] *= -1.0
    else:
        rows[:, 6] += off
    with pytest.raises(InvalidInputError, match="the pose slides: across the yaw it moves"):
        identified(tmp_path, rows, CART, twist=False)


def test_a_pose_may_be_measured_before_the_axle(tmp_path):
    rows = driven(CART, 0.1, 0.04)
    rows[:, 4] += 0.15 * np.cos(rows[:, 6])
    rows[:, 5] += 0.15 * np.sin(rows[:, 6])
    assert identified(tmp_path, rows, CART, twist=False).gain[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("name", "value"), [("forward", 50.0), ("turn", 85.94), ("sideways", 25.0)]
)
def test_what_no_robot_is_commanded_is_another_unit(name, value):
    given = {"forward": 0.5, "turn": 1.5, "sideways": 0.5} | {name: value}
    with pytest.raises(InvalidInputError, match=f"command: {name}: got {value}"):
        Command(**given)
