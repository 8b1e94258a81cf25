"""Logs of drives, as somebody records them: noise, dropped lines, jitter, two rates."""

import csv
import math

import numpy as np

from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.identification.identify import Runner

HEADER = ("time", "cmd_vx", "cmd_vy", "cmd_w", "x", "y", "yaw", "vx", "vy", "w")


def drive(walker, seed, seconds=25.0):
    """Drive a simulated walker: stops, turns, then random commands; return (n, 10) every 20 ms."""
    runner, rng = Runner(walker, seed), np.random.default_rng([7, seed])
    limits = walker.command.limits
    first = np.eye(len(limits))
    plan = []
    for k in range(len(limits)):
        for sign in (1.0, -1.0):
            plan += [(3.0, sign * limits * first[k]), (2.0, 0.0 * limits)]
    while sum(held for held, _ in plan) < seconds + 10.0 * len(limits):
        command = 0.8 * limits * rng.uniform(-1.0, 1.0, len(limits))
        moved = walker.command.in_plane(command)
        command /= max(1.0, np.hypot(*moved) / (0.8 * walker.command.forward))
        plan.append((rng.uniform(0.4, 2.0), command))
    rates = np.array([4.0] * (len(limits) - 1) + [16.0])
    rows, commands, time = [], 0.0 * limits, 0.0
    for k, (held, command) in enumerate(plan):
        commands = command if k < 4 * len(limits) else commands  # steps first
        for _ in range(round(held / CONTROL_DT)):
            commands = commands + np.clip(
                command - commands, -CONTROL_DT * rates, CONTROL_DT * rates
            )
            data, yaw = runner.drive.simulation.data, runner.drive.simulation.yaw
            cos, sin = math.cos(yaw), math.sin(yaw)
            ahead = cos * data.qvel[0] + sin * data.qvel[1]
            aside = cos * data.qvel[1] - sin * data.qvel[0]
            three = commands if len(commands) == 3 else (commands[0], 0.0, commands[1])
            rows.append([time, *three, *data.qpos[:2], yaw, ahead, aside, data.qvel[5]])
            runner.hold(commands, CONTROL_DT)
            time += CONTROL_DT
    return np.array(rows)


def driven(command, lag, delay, seed=0):
    """Return (n, 10) time, command, pose and twist of a robot with a lag of first order."""
    rng, limits = np.random.default_rng(seed), command.limits
    plan = []
    for k in range(len(limits)):
        for sign in (1.0, -1.0):
            plan += [(3.0, sign * limits * np.eye(len(limits))[k]), (2.0, 0.0 * limits)]
    plan += [(1.0, 0.8 * limits * rng.uniform(-1.0, 1.0, len(limits))) for _ in range(20)]
    commands = np.concatenate([np.tile(one, (round(held / CONTROL_DT), 1)) for held, one in plan])
    if len(limits) == 2:
        commands = np.column_stack([commands[:, 0], np.zeros(len(commands)), commands[:, 1]])
    pose, twist, rows = np.zeros(3), np.zeros(3), []
    for k, now in enumerate(commands):
        rows.append([CONTROL_DT * k, *now, *pose, *twist])
        late = commands[max(0, k - round(delay / CONTROL_DT))]
        twist = twist + (1.0 - math.exp(-CONTROL_DT / lag)) * (late - twist)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        moved = [cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1], twist[2]]
        pose = pose + CONTROL_DT * np.array(moved)
    return np.array(rows)


def recorded(rows, seed, *, rate=25.0, noise=0.005, lost=0.1, jitter=0.2, parts=("pose", "twist")):
    """Return lines as a recorder writes them: commands and measurements on lines of their own."""
    rng = np.random.default_rng([8, seed])
    commands = [[row[0], *row[1:4], *[None] * 6] for row in rows[:: round(0.04 / CONTROL_DT)]]
    end, time, measured = rows[-1, 0], 0.0, []
    while time < end:
        at = np.array([np.interp(time, rows[:, 0], entry) for entry in rows.T])
        at[6] = np.interp(time, rows[:, 0], np.unwrap(rows[:, 6]))
        pose = at[4:7] + noise * rng.standard_normal(3) * (0.2, 0.2, 0.2)
        pose[2] = math.remainder(pose[2], math.tau)
        twist = at[7:10] + noise * rng.standard_normal(3)
        line = [time, None, None, None]
        line += list(pose) if "pose" in parts else [None] * 3
        line += list(twist) if "twist" in parts else [None] * 3
        if rng.random() >= lost:
            measured.append(line)
        time += rng.uniform(1.0 - jitter, 1.0 + jitter) / rate
    return sorted(commands + measured, key=lambda line: line[0])


def write(path, lines, differential):
    """Write lines as CSV."""
    keep = [k for k, name in enumerate(HEADER) if not (differential and name == "cmd_vy")]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([HEADER[k] for k in keep])
        for line in lines:
            writer.writerow(["" if line[k] is None else f"{line[k]:.6f}" for k in keep])
    return path
