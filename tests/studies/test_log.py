"""A drive's log shows how a robot follows, whatever a recorder loses; others are refused."""

import math
import re
import subprocess
import sys

import numpy as np
import pytest
from drives import HEADER, drive, driven, recorded, write

from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command, Response, Walker
from hcbf_robots.identification import command
from hcbf_robots.identification.analysis import respond
from hcbf_robots.identification.identify import identify
from hcbf_robots.identification.log import identify_log
from hcbf_robots.identification.log_file import read

PARTS = {
    "both": {},
    "pose alone": {"parts": ("pose",)},
    "a noisy twist, a fifth lost": {"parts": ("twist",), "rate": 50.0, "noise": 0.01, "lost": 0.2},
    "10 Hz": {"rate": 10.0},
}


@pytest.mark.physics
@pytest.mark.parametrize("name", ["cart", "holonomic-cart"])
def test_a_log_shows_what_the_model_shows(name, tmp_path):
    walker = Walker.load(name)
    known = identify(walker, 20.0, 7).response
    rows = drive(walker, 0)
    for how in PARTS.values():
        lines = recorded(rows, 0, **how)
        file = write(tmp_path / "drive.csv", lines, walker.command.look_ahead is not None)
        found = identify_log(file, walker.command)[0].response
        assert found.complaints == []
        np.testing.assert_allclose(found.gain, known.gain, rtol=0.1)
        assert found.follows == pytest.approx(known.follows, abs=0.02)
        assert found.stopping == pytest.approx(known.stopping, rel=0.15)
        assert 0.7 * known.braking <= found.braking <= 1.1 * known.braking
        assert found.residual[1] >= 0.9 * known.residual[1]
        assert found.overshoot >= 0.9 * known.overshoot


def table(seed=0, tau=0.15, delay=0.06, gain=0.95, rest=2.0):
    """Return the lines of a drive of a differential robot, every 40 ms, twist and pose."""
    rng = np.random.default_rng(seed)
    plan = [(3.0, (0.5, 0.0)), (rest, (0.0, 0.0)), (3.0, (-0.5, 0.0)), (rest, (0.0, 0.0))]
    plan += [(2.0, (0.0, 1.5)), (2.0, (0.0, -1.5))]
    plan += [(1.0, tuple(rng.uniform(-1.0, 1.0, 2) * (0.5, 1.5))) for _ in range(25)]
    period = 0.02
    commanded = np.concatenate([np.tile(one, (round(held / period), 1)) for held, one in plan])
    late = np.concatenate([np.zeros((round(delay / period), 2)), commanded])[: len(commanded)]
    done = gain * np.column_stack([respond(entry, tau, period) for entry in late.T])
    time = period * np.arange(len(commanded))
    yaw = np.concatenate([[0.0], np.cumsum(done[:-1, 1]) * period])
    x = np.concatenate([[0.0], np.cumsum(done[:-1, 0] * np.cos(yaw[:-1])) * period])
    y = np.concatenate([[0.0], np.cumsum(done[:-1, 0] * np.sin(yaw[:-1])) * period])
    zero = np.zeros(len(commanded))
    parts = [time, commanded[:, 0], zero, commanded[:, 1], x, y, yaw, done[:, 0], zero, done[:, 1]]
    return np.column_stack(parts)[::2]


def test_a_known_response_is_found(tmp_path):
    file = write(tmp_path / "drive.csv", table().tolist(), differential=True)
    found = identify_log(file, look_ahead=0.2)[0].response
    assert found.gain == pytest.approx((0.95, 0.95), rel=0.03)
    assert found.follows == pytest.approx(0.21, abs=0.04)
    assert found.complaints == []


@pytest.mark.parametrize("off", [0.005, 0.01, 0.015])
def test_it_makes_no_difference_how_commands_lie_between_measurements(off, tmp_path):
    rows, found = table(tau=0.04, delay=0.0), []
    for shift in (0.0, off):
        commanded, done = rows.copy(), rows.copy()
        commanded[:, 4:] = np.nan
        done[:, 1:4] = np.nan
        done[:, 0] += shift  # the same drive, measured a little later
        for k in range(4, 10):
            done[:, k] = np.interp(done[:, 0], rows[:, 0], rows[:, k])
        lines = sorted([*commanded.tolist(), *done.tolist()], key=lambda line: line[0])
        lines = [[None if np.isnan(one) else one for one in line] for line in lines]
        file = write(tmp_path / "drive.csv", lines, differential=True)
        found.append(identify_log(file, look_ahead=0.2)[0].response.follows)
    assert found[1] == pytest.approx(found[0], abs=0.006)


DEGREES = 180.0 / math.pi
COMMANDS, POSE, YAW, VX, W = slice(1, 4), slice(4, 7), 6, 7, 9


def world(rows):
    """Turn the twist into the frame of the world."""
    cos, sin = np.cos(rows[:, YAW]), np.sin(rows[:, YAW])
    rows[:, 8], rows[:, VX] = sin * rows[:, VX], cos * rows[:, VX]


def put(where, value):
    return lambda rows: rows.__setitem__(where, value(rows[where]) if callable(value) else value)


def all_of(column, factor):
    return put(np.s_[:, column], lambda entries: factor * entries)


MALFORMED = {
    "degrees": ([all_of(W, DEGREES)], "disagree: w .* degrees"),
    "yaw in degrees": ([all_of(YAW, DEGREES)], "disagree: "),
    "degrees, no pose": (
        [all_of(POSE, np.nan), all_of(W, DEGREES)], "w: the robot turns .* degrees",
    ),
    "twist in the world": ([world], "disagree: v[xy]"),
    "half the speed": ([all_of(VX, 0.5)], "disagree: vx"),
    "commands .6 s late": (
        [put(np.s_[:, COMMANDS], lambda given: np.roll(given, 15, axis=0))],
        "before it is commanded to",
    ),
    "time backwards": ([put((100, 0), 90 * 0.04)], "line 102: got the time"),
    "never turns": ([all_of(3, 0.0), all_of(W, 0.0)], "cmd_w: got at most 0.*drive for 40 s"),
    "hardly turns": (
        [put(np.s_[:, 3], 0.5)], "cmd_w: got a command that hardly changes.*drive for 40 s",
    ),
    "short": ([all_of(0, 0.3)], "expected at least 20 s.*drive for 40 s"),
    "infinite": ([put((5, VX), np.inf)], "line 7: got 'inf'"),
    "a gap": ([put(np.s_[300:, 0], lambda time: time + 5.0)], "without a measurement"),
}  # fmt: skip


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_log_is_refused_in_words(name, tmp_path):
    changes, message = MALFORMED[name]
    rows = table()
    for change in changes:
        change(rows)
    lines = [[None if np.isnan(one) else one for one in row] for row in rows]
    file = write(tmp_path / "drive.csv", lines, differential=True)
    with pytest.raises(InvalidInputError, match=message):
        identify_log(file, look_ahead=0.2)


def test_a_drive_without_a_stop_is_refused(tmp_path):
    rows = table(rest=0.5)
    file = write(tmp_path / "drive.csv", rows[rows[:, 0] < 36.0].tolist(), differential=True)
    with pytest.raises(InvalidInputError, match=r"no stop.*drive for 40 s"):
        identify_log(file, look_ahead=0.2)


def test_a_swapped_sign_is_a_complaint(tmp_path):
    rows = table()
    rows[:, 4:] = rows[:, 4:] * (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)
    file = write(tmp_path / "drive.csv", rows.tolist(), differential=True)
    complaints = identify_log(file, look_ahead=0.2)[0].response.complaints
    assert len(complaints) == 1
    assert re.search(r"entry 1 .* against its sign", complaints[0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected time"),
        ("time,cmd_vx,cmd_w\n0,1,1\n", "x, y, yaw or vx, w"),
        ("time,cmd_vx,cmd_w,vx,w,speed\n", "speed"),
        ("time,cmd_vx,cmd_w,vx,w\n0,1,1,1\n", "line 2: got 4 cells"),
        ("time,cmd_vx,cmd_w,vx,w\n0,fast,1,1,1\n", "line 2: got 'fast'"),
        ("time,cmd_vx,cmd_w,vx,w\n,1,1,1,1\n", "line 2: got the time nan"),
        ("time,cmd_vx,cmd_w,vx,w\n0,1,1,1,1\n", "1 commands and 1 measurements"),
        (
            "time,cmd_vx,cmd_w,vx,w\n0,1,1,,\n1,1,1,,\n1e9,,,1,1\n2e9,,,1,1\n3e9,,,1,1\n",
            "the same clock",
        ),
    ],
)
def test_a_file_without_a_log_is_refused(text, message, tmp_path):
    file = tmp_path / "drive.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=message):
        read(file)


def test_without_a_contract_a_differential_drive_needs_its_point(tmp_path):
    file = write(tmp_path / "drive.csv", table().tolist(), differential=True)
    with pytest.raises(InvalidInputError, match="--look-ahead"):
        identify_log(file)
    _, commanded = identify_log(file, look_ahead=0.2)
    assert commanded.forward == pytest.approx(0.5)
    assert HEADER[0] == "time"


def test_the_command_writes_response_and_picture_without_mujoco(tmp_path):
    file = write(tmp_path / "drive.csv", table().tolist(), differential=True)
    blocked = "import sys; sys.modules.update(dict.fromkeys(('mujoco', 'pinocchio')))\n"
    code = f"""{blocked}from hcbf_gym import cli
cli.main(['identify', '--log', {str(file)!r}, '--look-ahead', '0.2'])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert Response.load(tmp_path / "drive.response.json").complaints == []
    assert (tmp_path / "drive.response.png").stat().st_size > 1000


def test_neither_contract_nor_log_is_refused():
    with pytest.raises(InvalidInputError, match="--log"):
        command.main(command.Args())


def identified(folder, rows, command, *, twist=True, late=0.0, seed=0):
    """Return what a log shows; `late` is by how much commands are stamped after they were given."""
    lines = [list(line) for line in recorded(rows, seed)]
    for line in lines:
        if line[1] is not None:
            line[0] += late
        if not twist:
            line[7:] = [None] * len(line[7:])
    lines.sort(key=lambda line: line[0])
    file = write(folder / "drive.csv", lines, command.sideways is None)
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
