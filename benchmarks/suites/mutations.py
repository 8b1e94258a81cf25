"""Malformed inputs: each is refused with an error of this package, or makes sense."""

import contextlib
import copy
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.envs.regions import RegionsEnv
from hcbf_gym.errors import HcbfError
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.robots import a1

SECONDS = 60.0  # Of processor time that a case may take

POISON: tuple[Any, ...] = (
    *(None, True, "", "a", "floor", [], {}, [1.0], [[1.0, 2.0]], 1j),
    *(0, -1, 1e-300, 1e300, 10**400, float("nan"), float("inf")),
)
XML_POISON = ("", "x", "nan", "inf", "0", "-1", "1e300", "1e-300", "1 2 3 4 5 6 7", "floor")

OUTCOMES = ("refused", "accepted", "raw error", "hang", "nonsense")
"""What may become of a malformed input."""
WRONG = OUTCOMES[2:]  # What must not

RANDOMIZATION = {
    "floor_friction": [0.4, 0.8],
    "payload": [0.0, 4.0],
    "payload_position": [0.06, 0.03, 0.08],
    "motor_strength": [0.9, 1.0],
    "delay": [0.0, 0.004],
    "sensor_noise": 1.0,
    "start_distance": 0.1,
    "start_yaw": [0.0, 0.2],
}
DISTURBANCES: tuple[dict[str, Any], ...] = (
    {"kind": "random", "interval": 4.0, "impulse": [5.0, 20.0], "duration": 0.1, "until": 20.0},
    {"kind": "scheduled", "pushes": [{"time": 0.0, "duration": 0.1, "force": [0.0, 300.0, 0.0]}]},
)


class Nonsense(Exception):  # noqa: N818 - what a case shows, no error of the program
    """What was accepted does not make sense."""


def run(quick: bool) -> dict[str, Any]:
    """Mutate 2,000 inputs, or 200, and count what became of them."""
    count = 50 if quick else 500
    rows = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # MuJoCo leaves a log
        for kind, case in CASES.items():
            outcomes = [judge(case, generator(kind, seed)) for seed in range(count)]
            seen = Counter(outcome for outcome, _ in outcomes)
            wrong = [
                f"seed {seed}: {text}"
                for seed, (outcome, text) in enumerate(outcomes)
                if outcome in WRONG
            ]
            counts = {outcome: seen[outcome] for outcome in OUTCOMES}
            rows.append({"kind": kind, "mutations": count, **counts, "wrong": wrong})
    return {"figures": rows}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return how many of each kind were refused, accepted, or mishandled."""
    header = ("malformed", "mutations", *OUTCOMES)
    keys = ("kind", *header[1:])
    rows = [[str(row[key]) for key in keys] for row in figures["figures"]]
    return {"all": Table("Inputs mutated at random", header, rows)}


def generator(kind: str, seed: int) -> np.random.Generator:
    """Return what decides a mutation: to try one again that went wrong."""
    return np.random.default_rng([seed, list(CASES).index(kind)])


def judge(case: Callable[[np.random.Generator], None], rng: np.random.Generator) -> tuple[str, str]:
    """Return one of `OUTCOMES`, and the message where one was raised."""
    try:
        with time_limit(SECONDS):
            case(rng)
    except HcbfError as error:
        return "refused", str(error)
    except TimeoutError as error:
        return "hang", str(error)
    except Nonsense as error:
        return "nonsense", str(error)
    except Exception as error:
        return "raw error", f"{type(error).__name__}: {error}"
    return "accepted", ""


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in what takes longer; of the main thread alone."""

    def stop(_signal: int, _frame: Any) -> None:
        raise TimeoutError(f"no answer within {seconds:g} s")

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def mutated(data: Any, rng: np.random.Generator) -> Any:
    """Return a copy of JSON data with one entry replaced, scaled, left out or doubled."""
    copied = copy.deepcopy(data)
    places = list(_places(copied))
    holder, key = places[rng.integers(len(places))]
    value, how = holder[key], rng.random()
    if how < 0.2 and isinstance(value, float | int) and value:
        holder[key] = value * 10.0 ** rng.uniform(-6.0, 6.0) * rng.choice([-1.0, 1.0])
    elif how < 0.35:
        del holder[key]
    elif how < 0.45:
        if isinstance(holder, dict):
            holder[f"{key}s"] = value
        else:
            holder.append(copy.deepcopy(value))
    else:
        holder[key] = copy.deepcopy(POISON[rng.integers(len(POISON))])
    return copied


def _places(data: Any) -> Iterator[tuple[Any, Any]]:
    keys = data if isinstance(data, dict) else range(len(data))
    for key in keys:
        yield data, key
        if isinstance(data[key], dict | list):
            yield from _places(data[key])


def mutated_xml(text: str, rng: np.random.Generator) -> str:
    """Return an MJCF text with one attribute or element replaced, scaled, left out or doubled."""
    root = ElementTree.fromstring(text)
    parents = {child: parent for parent in root.iter() for child in parent}
    elements = list(parents)
    element = elements[rng.integers(len(elements))]
    names, how = sorted(element.attrib), rng.random()
    name = names[rng.integers(len(names))] if names else "name"
    if how < 0.1:
        parents[element].remove(element)
    elif how < 0.2:
        parents[element].append(copy.deepcopy(element))
    elif how < 0.35:
        element.attrib.pop(name, None)
    elif how < 0.6:
        element.set(name, _scaled(element.get(name, ""), rng))
    else:
        element.set(name, str(rng.choice(XML_POISON)))
    return ElementTree.tostring(root, encoding="unicode")


def _scaled(text: str, rng: np.random.Generator) -> str:
    words = text.split()
    for k in rng.permutation(len(words)):
        with contextlib.suppress(ValueError):
            words[k] = repr(float(words[k]) * 10.0 ** rng.uniform(-4.0, 4.0) * rng.choice([-1, 1]))
            break
    return " ".join(words)


def _scenario(rng: np.random.Generator) -> None:
    name = ("paper-simulation", "paper-experiment", "random", "random-moving")[rng.integers(4)]
    data = mutated(scenarios.make(name, rng).to_dict(), rng)
    env = RegionsEnv(scenario=data)
    observation, info = env.reset(seed=0)
    for _ in range(5):
        observation, _, _, _, info = env.step(np.zeros(2))
    if not (np.isfinite(observation).all() and np.isfinite(info["h"]).all()):
        raise Nonsense(f"observation {observation.tolist()}, h {info['h'].tolist()}")
    A1Physics(obstacles=env.scenario.obstacles)


def _randomization(rng: np.random.Generator) -> None:
    data = mutated(RANDOMIZATION, rng)
    _fall_free(data, A1Physics(randomization=data), rng)


def _disturbance(rng: np.random.Generator) -> None:
    data = mutated({"of": DISTURBANCES[rng.integers(2)]}, rng).get("of")
    _fall_free(data, A1Physics(disturbances=data), rng)


def _fall_free(data: Any, physics: A1Physics, rng: np.random.Generator) -> None:
    """Let the robot hang in its motors for some ticks: the numbers must stay finite."""
    physics.reset(np.zeros(2), 0.0, rng)
    for _ in range(10):
        physics.step(np.zeros(12))
    if physics.diverged or not np.isfinite(physics.state().vector).all():
        raise Nonsense(f"{data!r}: the physics diverged")


def _robot(rng: np.random.Generator) -> None:
    path = Path("robot.xml")
    path.write_text(mutated_xml(a1.XML_FILE.read_text(encoding="utf-8"), rng), encoding="utf-8")
    physics, controller = A1Physics(path), LocomotionController(path)
    physics.reset(np.zeros(2), 0.0, rng)
    controller.reset(physics.state())
    for _ in range(150):
        physics.step(controller.step(physics.state(), np.zeros(2)))
    if physics.fallen:
        raise Nonsense("the robot falls on the spot")


CASES: dict[str, Callable[[np.random.Generator], None]] = {  # What is mutated, and a trial of it
    "scenario": _scenario,
    "randomization": _randomization,
    "disturbance": _disturbance,
    "robot": _robot,
}
