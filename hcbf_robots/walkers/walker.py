"""A robot that takes velocities, described by a contract: a JSON file of robot and controller.

>>> cart = Walker.load("cart")
>>> cart.command.limits  # (v, ω) [m/s, rad/s]
array([1.2, 2.5])
"""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import (
    HcbfError,
    InvalidInputError,
    RobotModelError,
    UnknownNameError,
    finite_float,
    in_words,
    reals,
    shown,
)
from hcbf_gym.robots.body_points import radius, stand
from hcbf_gym.robots.mjcf_files import read_by
from hcbf_gym.robots.reader import compile_spec
from hcbf_robots import carts
from hcbf_robots.walkers import walker_policy, walker_terms
from hcbf_robots.walkers.walker_model import FREE_JOINT_SIZE, Parts, indices, walker_spec
from hcbf_robots.walkers.walker_parts import Action, Body, Command, Fall, Phase, Physics, spread
from hcbf_robots.walkers.walker_policy import Controller
from hcbf_robots.walkers.walker_response import Response
from hcbf_robots.walkers.walker_terms import Term

SLOWEST_PERIOD = 0.2  # of a controller [s]

NAMES = {name: carts.FOLDER / f"{name}.json" for name in ("cart", "holonomic-cart")}
"""Name → contract of the walkers that the package has."""

_RESPONSE = ".response.json"  # suffix of the file beside the contract
_RECORDS = (Command, Action, Body, Fall, Phase, Physics)
_SECTIONS = {record.__name__.lower(): record for record in _RECORDS}
_DEFAULTS = {"phase": None, "physics": Physics()}  # of the sections that a contract may leave out


@dataclass(frozen=True)
class Walker:
    """A robot that takes velocities, and the controller that moves it.

    Attributes:
        name: the robot's name in tables and messages.
        mjcf: the robot's file.
        policy: the controller: an ONNX file, ``module:function`` or ``file.py:function``.
        period: how long the controller holds an action [s].
        observation: the terms that the controller observes.
        action: how the controller's output drives the actuators.
        command: the velocities that the robot may be commanded.
        body: the robot's body.
        fall: when the robot counts as fallen.
        phase: the controller's clock; None for none.
        physics: how the file is simulated.
        source: the contract's file.
        response: how the robot follows commands, as `hcbf identify` measured it; None before.
    """

    name: str
    mjcf: Path
    policy: str
    period: float
    observation: tuple[Term, ...]
    action: Action
    command: Command
    body: Body
    fall: Fall
    phase: Phase | None
    physics: Physics
    source: Path
    response: Response | None

    @classmethod
    def load(cls, path: str | Path) -> "Walker":
        """Read a contract, and check it against the robot's file and the controller.

        Args:
            path: of the JSON file, or a name of `NAMES`. Paths in the file are relative to its
                folder; ``$NAME`` is an environment variable.

        Raises:
            InvalidInputError: if a key is missing, unknown or malformed, or numbers do not fit.
            RobotModelError: if the MJCF or the network is missing or does not fit the contract.
            MissingDependencyError: if the network needs the extra `walkers`.
        """
        file = _find(path)
        walker = _read(file)
        try:
            walker.check()
        except HcbfError as error:
            raise type(error)(f"walker {walker.name!r} ({file}): {error}") from error
        return walker

    @property
    def response_file(self) -> Path:
        """Where `hcbf identify` writes the response: beside the contract."""
        return self.source.with_suffix(_RESPONSE)

    @property
    def files(self) -> list[Path]:
        """All files that define the robot: contract, MJCF and its parts, controller, response."""
        files = {self.source, self.response_file, *read_by(self.mjcf)}
        files |= set(walker_policy.files(self.policy, self.source.parent))
        return sorted(file for file in files if file.is_file())

    def spec(self) -> tuple[mujoco.MjSpec, Parts]:
        """Return the robot alone, as the contract changes it, and the names of its parts."""
        sensors = walker_terms.sensors_of(self.observation)
        spec, parts = walker_spec(self.mjcf, self.body, self.action, self.physics, sensors)
        walker_terms.add_touch_sensors(spec, self.observation)
        return spec, parts

    @cached_property
    def reach(self) -> float:
        """Radius around the trunk that contains the moving robot, see `Body.reach` [m]."""
        if self.body.reach is not None:
            return self.body.reach
        spec, parts = self.spec()
        return radius(compile_spec(spec, self.mjcf), parts.trunk, parts.home)

    def scale(self, parts: Parts) -> Array:
        """Return (k,) the factors of the controller's output."""
        return spread("action: scale", self.action.scale, len(parts.actuators))

    def offset(self, parts: Parts, at: Integers) -> Array:
        """Return (k,) the offsets of the output: home of the joints `at` (k,) in qpos, or zeros."""
        if self.action.kind == "direct":
            return np.zeros(len(parts.actuators))
        return parts.home[at - FREE_JOINT_SIZE]

    def controller(self, sizes: tuple[int, int], model: mujoco.MjModel) -> Controller:
        """Return the controller for one episode.

        Args:
            sizes: number of entries of the observation and of the action.
            model: the compiled scene.
        """
        return walker_policy.make(self.policy, self.source.parent, sizes)(model, self.period)

    @cached_property
    def first_phase(self) -> Array:
        """(p,) phases of the controller's clock at the start [rad]; empty without a clock."""
        return np.array([] if self.phase is None else self.phase.start, dtype=np.float64)

    def check(self) -> None:
        """Let the controller act once on the robot as it starts.

        Raises:
            HcbfError: if file, contract and controller do not fit each other.
        """
        spec, parts = self.spec()
        model = compile_spec(spec, self.mjcf)
        self._check_model(model)
        data = mujoco.MjData(model)
        stand(data, np.zeros(2), self.body.height, 0.0, parts.home)
        mujoco.mj_forward(model, data)
        self.scale(parts)  # raises where the contract has another number of scales
        count = len(parts.actuators)
        places, command = indices(model, parts), np.zeros(len(self.command.limits))
        phase, last_action = self.first_phase.copy(), np.zeros(count)
        source = walker_terms.Source(model, data, parts, places, command, last_action, phase)
        observer = walker_terms.Observer(self.observation, source)
        controller = self.controller((observer.size, count), model)
        observation = observer.observe()
        try:
            action = reals("policy: action", controller(observation))
        except HcbfError:
            raise
        except Exception as error:  # a user's own function
            raise InvalidInputError(f"policy: {self.policy} raised {in_words(error)}") from error
        if action.shape != (count,) or not np.isfinite(action).all():
            raise InvalidInputError(
                f"policy: got {action.tolist()} at the start, expected {count} finite numbers, one "
                f"for each of {list(parts.actuators)}"
            )

    def _check_model(self, model: mujoco.MjModel) -> None:
        """Refuse a period between two physics steps, and a robot that touches nothing."""
        timestep = model.opt.timestep
        ticks = self.period / timestep
        if abs(ticks - round(ticks)) > 1e-6 or ticks < 0.5:
            raise InvalidInputError(
                f"period: got {self.period} s, expected a multiple of the physics step of "
                f"{timestep:g} s"
            )
        if not (model.geom_contype.any() or model.geom_conaffinity.any()):
            raise RobotModelError(
                f"mjcf: got {self.mjcf} with no geom that touches anything, expected feet or "
                "wheels whose contype or conaffinity is not 0"
            )


def _find(path: str | Path) -> Path:
    """Return the file of a contract that is given by its path or its name."""
    if not isinstance(path, str | Path):
        raise InvalidInputError(
            f"robot: got {shown(path)}, expected a contract's path or one of {list(NAMES)}"
        )
    if str(path) in NAMES:
        return NAMES[str(path)]
    if isinstance(path, str) and not path.endswith(".json"):
        hint = "; the A1, which takes accelerations, is 'HCBF-A1Regions-v0'" if path == "a1" else ""
        raise UnknownNameError(
            f"unknown robot: got {path!r}, expected a contract's path, which ends in .json, or one "
            f"of {list(NAMES)}{hint}"
        )
    file = Path(_expanded("robot", str(path)))
    if not file.is_file():
        raise InvalidInputError(f"robot: got {str(path)!r}, expected an existing JSON file")
    return file.resolve()


def _read(file: Path) -> Walker:
    """Return the walker of a contract, before it is checked against the MJCF and the controller."""
    data = records.read_json("robot", file)
    what = f"walker ({file})"
    records.check_mapping(what, data)
    keys = [field.name for field in fields(Walker) if field.name not in ("source", "response")]
    missing = [key for key in keys if key not in data and key not in _DEFAULTS]
    unknown = sorted(set(data) - set(keys))
    if missing or unknown:
        raise InvalidInputError(
            f"{what}: got missing key(s) {missing} and unknown key(s) {unknown}, expected the keys "
            f"{keys}"
        )
    sections: dict[str, Any] = dict(_DEFAULTS)
    for key, section in _SECTIONS.items():
        if data.get(key) is not None:
            records.check_mapping(f"{what}: {key}", data[key])
            sections[key] = records.build(f"{what}: {key}", section, data[key])
        elif key in data and key not in _DEFAULTS:
            raise InvalidInputError(f"{what}: {key}: got None, expected a mapping")
    texts = {key: _text(f"{what}: {key}", data[key]) for key in ("name", "mjcf", "policy")}
    period = finite_float(
        f"{what}: period", data["period"], minimum=0.0, maximum=SLOWEST_PERIOD, exclusive=True
    )
    response_file = file.with_suffix(_RESPONSE)
    response = Response.load(response_file) if response_file.is_file() else None
    if response is not None:
        response.gains(len(sections["command"].limits))  # raises if their number does not fit
    return Walker(
        name=texts["name"],
        mjcf=file.parent / _expanded(f"{what}: mjcf", texts["mjcf"]),
        policy=_expanded(f"{what}: policy", texts["policy"]),
        period=period,
        observation=walker_terms.read_terms(data["observation"]),
        source=file,
        response=response,
        **sections,
    )


def _text(what: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise InvalidInputError(f"{what}: got {value!r}, expected text")
    return value


def _expanded(what: str, path: str) -> str:
    """Return a path of the contract with its environment variables expanded."""
    try:
        return records.expanded(what, path)
    except InvalidInputError as error:
        raise RobotModelError(str(error)) from error
