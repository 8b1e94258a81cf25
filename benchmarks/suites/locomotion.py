"""Quality, robustness and speed of the walk, each figure beside its requirement."""

from typing import Any

import numpy as np

from benchmarks.common import parallel, table
from benchmarks.suites.locomotion_speed import speed_figures
from benchmarks.suites.walks import (
    DT,
    Measure,
    Walk,
    follow_course,
    slip_per_step,
    stride_average,
    towards,
    walk,
)
from hcbf_gym.arrays import Array
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.locomotion.controller import BodyReference
from hcbf_gym.locomotion.gait import GAITS
from hcbf_gym.locomotion.state import RobotState
from hcbf_gym.models.constants import GRAVITY

OFF_NOMINAL: dict[str, dict[str, Any]] = {
    "payload 4 kg, 6 cm ahead, 3 cm left": {"payload": 4.0, "payload_position": [0.06, 0.03, 0.08]},
    "torque × 0.9": {"motor_strength": 0.9},
    "delay 4 ms": {"delay": 0.004},
    "sensor noise": {"sensor_noise": 1.0},
    "floor friction 0.5": {"floor_friction": 0.5},
}


def run(quick: bool) -> dict[str, Any]:
    """Take all figures and return them."""
    parts = [
        steady_figures(quick),
        [] if quick else manoeuvre_figures(),
        push_figures(quick),
        [] if quick else course_figures(),
        off_nominal_figures(quick),
        speed_figures(quick),
    ]
    figures = [figure for part in parts for figure in part]
    return {"figures": [f._asdict() | {"value": float(f.value), "met": f.met} for f in figures]}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return every figure beside its bound."""
    columns = {
        "": "{section}: {name}",
        "figure": lambda f: "fell" if f["value"] is None else f"{f['value']:.4g}",
        "unit": "{unit}",
        "asked": lambda f: f"{'≥' if f['at_least'] else '≤'} {f['bound']:g}",
        "met": lambda f: "yes" if f["met"] else "no",
    }  # fmt: skip
    title = "Unitree A1, flat floor, 500 Hz, self-collision on"
    return {"all": table(title, figures["figures"], columns)}


def steady_figures(quick: bool) -> list[Measure]:
    """Walk at constant velocities with a fixed heading."""
    seconds = 7.0 if quick else 24.0
    forward = [(v, 0.0) for v in (0.0, 0.3, 0.6, 0.8, 1.0, 1.2)]
    velocities = [(1.0, 0.0)] if quick else [*forward, (0.0, 0.6), (-0.8, 0.0)]
    figures = []
    for velocity, values in zip(
        velocities, parallel(steady, [(v, seconds) for v in velocities]), strict=True
    ):
        name = f"v = ({velocity[0]:g}, {velocity[1]:g}) m/s"
        rms = 0.07 if velocity[0] > 1.1 else 0.06
        bounds = (rms, 0.005, 5.0, 1.5, 2.0, 0.5, 0.0, 1.5)
        labels = (
            ("velocity RMS", "m/s"),
            ("velocity RMS, stride average", "m/s"),
            ("height off its mean", "mm"),
            ("roll or pitch", "°"),
            ("slip a step", "mm"),
            ("yaw drift", "°/min"),
            ("ticks with a saturated motor", ""),
            ("cost of transport", ""),
        )
        figures += [
            Measure(label, name, value, unit, bound)
            for (label, unit), value, bound in zip(labels, values, bounds, strict=True)
            if label != "cost of transport" or velocity == (1.0, 0.0)
        ]
    return figures


def steady(velocity: tuple[float, float], seconds: float) -> tuple[float, ...]:
    """Return the figures of `steady_figures` for one velocity (2,) [m/s].

    The cost of transport is the joints' positive mechanical power over weight and speed, ``mean
    Σ max(τ q̇, 0) / (m g v)``: braking gives nothing back. It is infinite on the spot.
    """
    goal = np.array(velocity)
    walked = walk(seconds, towards(goal, 2.0), heading="fixed")
    if walked.fell:
        return (np.inf,) * 8
    start = round(4.0 / DT)  # the start's transient has gone
    error = walked.state.linear_velocity[start:, :2] - goal
    height = walked.state.position[start:, 2]
    yaw, tilt = orientation(walked)
    heading = stride_average(yaw[start:])
    rate, torque = walked.state.joint_velocity[start:], walked.torque[start:]
    during = 0.5 * (rate[:-1] + rate[1:])
    power = float(np.maximum(torque[:-1] * during, 0.0).sum(axis=1).mean())
    weight, speed = GRAVITY * walked.mass, float(np.linalg.norm(goal))
    drift = np.polyfit(np.arange(len(heading)), heading, 1)[0] * 60.0 / GAITS["trot"].period
    return (
        root_mean_square(error),
        root_mean_square(stride_average(error)),
        1e3 * float(np.abs(height - height.mean()).max()),
        float(np.degrees(tilt[start:].max())),
        1e3 * slip_per_step(walked, start),
        float(np.degrees(abs(drift))),
        float(walked.saturated[start:].sum()),
        power / (weight * speed) if speed > 0.0 else np.inf,
    )


def orientation(walked: Walk) -> tuple[Array, Array]:
    """Return (n,) yaw and (n,) the larger of roll and pitch [rad]."""
    w, x, y, z = walked.state.quaternion.T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(2 * (w * y - z * x))
    return yaw, np.maximum(np.abs(roll), np.abs(pitch))


def root_mean_square(errors: Array) -> float:
    """Return the root mean square of the lengths of errors (n, 2)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def manoeuvre_figures() -> list[Measure]:
    """Turn, start, stop and reverse."""

    def turn(t: float, reference: BodyReference, _state: RobotState) -> Array:
        v = reference.velocity
        rate = np.radians(90.0) / 1.5 if 2.0 <= t < 3.5 else 0.0
        return np.array([2.0, 0.0]) if t < 0.3 else rate * np.array([-v[1], v[0]])

    turned = walk(5.0, turn)
    velocity = turned.reference[:, 2:4]
    yaw, _ = orientation(turned)
    error = yaw - np.arctan2(velocity[:, 1], velocity[:, 0])
    error = np.abs((error + np.pi) % (2 * np.pi) - np.pi)[round(1.0 / DT) :]

    def dash(t: float, _reference: BodyReference, _state: RobotState) -> Array:
        return np.array([5.0 * (t < 0.16) - 5.0 * (2.0 <= t < 2.16), 0.0])

    stopped = walk(4.0, dash, heading="fixed")
    overshoot = 1e2 * float(stopped.state.position[:, 0].max() - stopped.reference[-1, 0])

    def reverse(t: float, _reference: BodyReference, _state: RobotState) -> Array:
        return np.array([5.0 * (t < 0.16) - 5.0 * (2.0 <= t < 2.32), 0.0])

    reversed_ = walk(6.0, reverse, heading="fixed")
    miss = reversed_.state.linear_velocity[:, :2] - reversed_.reference[:, 2:4]
    left_over = root_mean_square(stride_average(miss[-round(1.0 / DT) :]))
    return [
        Measure("90° turn in 1.5 s at 0.6 m/s", "yaw error", np.degrees(error.max()), "°", 6.0),
        Measure("start and stop, 5 m/s² to 0.8 m/s", "past the stop", overshoot, "cm", 3.0),
        Measure("reversal at 0.8 m/s", "velocity error after", left_over, "m/s", 0.02),
        Measure("reversal at 0.8 m/s", "upright", float(not reversed_.fell), "", 1.0, True),
    ]


def push_figures(quick: bool) -> list[Measure]:
    """Push the robot, and jerk it about."""
    period = GAITS["trot"].period
    count = 1 if quick else 16
    phases = np.arange(count) * period / count
    figures = []
    for impulse, share in ((30.0, 1.0), (40.0, 0.75)):
        jobs = [((0.8, 0.0), "trot", 2.0 + phase, (0.0, impulse)) for phase in phases]
        upright = sum(parallel(survives_push, jobs))
        name = f"lateral {impulse:g} N·s at 0.8 m/s, {len(jobs)} gait phases"
        bound = share * len(jobs)
        figures.append(Measure("pushes", name, float(upright), "upright", bound, True))
    angles = np.arange(1 if quick else 8) * np.pi / 4
    for impulse in (15.0, 20.0):
        jobs = [
            ((0.0, 0.0), "stand", 1.0, (impulse * np.cos(a), impulse * np.sin(a))) for a in angles
        ]
        upright = sum(parallel(survives_push, jobs))
        name = f"standing {impulse:g} N·s, {len(angles)} directions"
        bound = float(len(angles))
        figures.append(Measure("pushes", name, float(upright), "upright", bound, True))
    episodes = 1 if quick else 50
    upright = sum(parallel(survives_random_input, [(seed,) for seed in range(episodes)]))
    name = f"u in ±5 m/s² held 0.2 s for 20 s, {episodes} episodes"
    return [*figures, Measure("random input", name, upright, "upright", episodes, True)]


def survives_push(
    velocity: tuple[float, float], gait: str, time: float, impulse: tuple[float, float]
) -> bool:
    """Return whether the robot stays upright through a push of 0.1 s."""
    push = {"time": time, "duration": 0.1, "force": [10.0 * impulse[0], 10.0 * impulse[1], 0.0]}
    plant = {"disturbances": {"kind": "scheduled", "pushes": [push]}}
    goal = towards(np.array(velocity), 2.0)
    return not walk(time + 3.0, goal, simulation=plant, gait=gait, heading="fixed").fell


def survives_random_input(seed: int) -> bool:
    """Return whether the robot stays upright for 20 s under inputs that jump every 0.2 s."""
    inputs = np.random.default_rng(seed).uniform(-5.0, 5.0, (100, 2))
    return not walk(20.0, lambda t, _reference, _state: inputs[int((t + 1e-9) / 0.2)]).fell


def course_figures() -> list[Measure]:
    """Walk the paper's course, unfiltered, on the nominal plant."""
    walked, error = follow_course()
    rms = float(np.sqrt((error[round(1.0 / DT) :] ** 2).mean()))
    name = "the paper's course, 20 s"
    return [
        Measure(name, "tracking RMS after 1 s", rms, "m", 0.01),
        Measure(name, "final error", float(error[-1]), "m", 0.01),
        Measure(name, "QPs without a solution", walked.failed, "of 10000", 0.0),
    ]


def off_nominal_figures(quick: bool) -> list[Measure]:
    """Walk the course on plants that the controller does not know of; if quick, on the last."""
    everything: dict[str, Any] = {}
    for ranges in OFF_NOMINAL.values():
        everything |= ranges
    plants: dict[str, dict[str, Any]] = {
        name: {"randomization": ranges} for name, ranges in OFF_NOMINAL.items()
    }
    plants["all at once"] = {"randomization": everything}
    plants["rough ground, 3 cm"] = {"terrain": "rough"}
    plants["all at once on rough ground"] = {"randomization": everything, "terrain": "rough"}
    if quick:
        plants = dict([plants.popitem()])
    errors = parallel(course_error, [(plant,) for plant in plants.values()])
    return [
        Measure("course off nominal", name, error, "m at the end", 0.2)
        for name, error in zip(plants, errors, strict=True)
    ]


def course_error(plant: dict[str, Any]) -> float:
    """Return the final error on the course, infinite after a fall [m]."""
    walked, error = follow_course(plant)
    return np.inf if walked.fell else float(error[-1])
