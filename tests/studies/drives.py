"""Logs of drives, as somebody records them: noise, dropped lines, jitter, two rates."""

import csv
import math

import numpy as np

from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.identification.record import Runner

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
    rows, told, time = [], 0.0 * limits, 0.0
    for k, (held, command) in enumerate(plan):
        told = command if k < 4 * len(limits) else told  # steps first
        for _ in range(round(held / CONTROL_DT)):
            told = told + np.clip(command - told, -CONTROL_DT * rates, CONTROL_DT * rates)
            data, yaw = runner.drive.simulation.data, runner.drive.simulation.yaw
            cos, sin = math.cos(yaw), math.sin(yaw)
            ahead = cos * data.qvel[0] + sin * data.qvel[1]
            aside = cos * data.qvel[1] - sin * data.qvel[0]
            three = told if len(told) == 3 else (told[0], 0.0, told[1])
            rows.append([time, *three, *data.qpos[:2], yaw, ahead, aside, data.qvel[5]])
            runner.tell(told, CONTROL_DT)
            time += CONTROL_DT
    return np.array(rows)


def recorded(rows, seed, *, rate=25.0, noise=0.005, lost=0.1, jitter=0.2, parts=("pose", "twist")):
    """Return lines as a recorder writes them: commands and measurements on lines of their own."""
    rng = np.random.default_rng([8, seed])
    told = [[row[0], *row[1:4], *[None] * 6] for row in rows[:: round(0.04 / CONTROL_DT)]]
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
    return sorted(told + measured, key=lambda line: line[0])


def write(path, lines, differential):
    """Write lines as CSV."""
    keep = [k for k, name in enumerate(HEADER) if not (differential and name == "cmd_vy")]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([HEADER[k] for k in keep])
        for line in lines:
            writer.writerow(["" if line[k] is None else f"{line[k]:.6f}" for k in keep])
    return path
