"""A robot that takes velocities, by contract: a JSON file describes it and its controller.

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
    shown,
)
from hcbf_gym.robots.body_points import radius, stand
from hcbf_gym.robots.reader import compile_spec
from hcbf_robots import carts
from hcbf_robots.walkers import walker_policy
from hcbf_robots.walkers.mjcf_files import read_by
from hcbf_robots.walkers.walker_model import Parts, indices, walker_spec
from hcbf_robots.walkers.walker_parts import Action, Body, Command, Fall, Phase, Physics, spread
from hcbf_robots.walkers.walker_policy import Controller
from hcbf_robots.walkers.walker_response import Response
from hcbf_robots.walkers.walker_terms import (
    Observer,
    Source,
    Term,
    add_touch_sensors,
    read_terms,
    sensors_of,
)

SLOWEST_PERIOD = 0.2  # of a controller [s]

NAMES = {name: carts.FOLDER / f"{name}.json" for name in ("cart", "holonomic-cart")}
"""name → contract of the walkers that the package brings along."""

_PARTS = {part.__name__.lower(): part for part in (Command, Action, Body, Fall, Phase, Physics)}
_OPTIONAL = {"phase": None, "physics": Physics()}


@dataclass(frozen=True)
class Walker:
    """What a robot is that takes velocities, and the controller that makes it move.

    Attributes:
        name: what tables and messages call it.
        mjcf: the robot's file.
        policy: an ONNX file, ``module:function`` or ``file.py:function``.
        period: how long the controller holds an action [s].
        observation: what the controller sees.
        action: what its output does.
        command: what it may be commanded.
        body: the robot's body.
        fall: when it counts as fallen.
        phase: the controller's clock; None for none.
        physics: how the file is simulated.
        source: the contract's file.
        response: how it follows commands, as `hcbf identify` measured it; None before.
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
            path: of the JSON file, or a name of `NAMES`. Paths in the file count from its folder;
                ``$NAME`` is an environment variable.

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
        return _response_file(self.source)

    @property
    def files(self) -> list[Path]:
        """What decides the robot: contract, MJCF with all that it reads, controller, response."""
        files = {self.source, self.response_file, *read_by(self.mjcf)}
        files |= set(walker_policy.files(self.policy, self.source.parent))
        return sorted(file for file in files if file.is_file())

    def spec(self) -> tuple[mujoco.MjSpec, Parts]:
        """Return the robot alone, as the contract changes it, and the names of its parts."""
        sensors = sensors_of(self.observation)
        spec, parts = walker_spec(self.mjcf, self.body, self.action, self.physics, sensors)
        add_touch_sensors(spec, self.observation)
        return spec, parts

    @cached_property
    def reach(self) -> float:
        """Radius of the circle around the trunk's centre that holds the moving robot [m].

        The contract's, or what follows from the geoms at home.
        """
        if self.body.reach is not None:
            return self.body.reach
        spec, parts = self.spec()
        return radius(compile_spec(spec, self.mjcf), parts.trunk, parts.home)

    def scale(self, parts: Parts) -> Array:
        """Return (k,) by which the controller's output is multiplied."""
        return spread("action: scale", self.action.scale, len(parts.actuators))

    def offset(self, parts: Parts, at: Integers) -> Array:
        """Return (k,) what is added to it: home, or nothing; `at` (k,) are the joints in qpos."""
        if self.action.kind == "direct":
            return np.zeros(len(parts.actuators))
        return parts.home[at - 7]

    def controller(self, sizes: tuple[int, int], model: mujoco.MjModel) -> Controller:
        """Return the controller for one episode.

        Args:
            sizes: n of the observation and k of the action.
            model: the compiled scene.
        """
        return walker_policy.make(self.policy, self.source.parent, sizes)(model, self.period)

    @cached_property
    def first_phase(self) -> Array:
        """(p,) the clock's phases at the start [rad]; empty without a clock."""
        return np.array([] if self.phase is None else self.phase.start, dtype=np.float64)

    def check(self) -> None:
        """Let the controller act once on the robot as it starts.

        Raises:
            HcbfError: if file, contract and controller do not fit each other.
        """
        spec, parts = self.spec()
        model = compile_spec(spec, self.mjcf)
        ticks = self.period / model.opt.timestep
        if abs(ticks - round(ticks)) > 1e-6 or ticks < 0.5:
            raise InvalidInputError(
                f"period: got {self.period} s, expected a multiple of the physics step of "
                f"{model.opt.timestep:g} s"
            )
        if not (model.geom_contype.any() or model.geom_conaffinity.any()):
            raise RobotModelError(
                f"mjcf: got {self.mjcf} with no geom that touches anything, expected feet or "
                "wheels whose contype or conaffinity is not 0"
            )
        data = mujoco.MjData(model)
        stand(data, np.zeros(2), self.body.height, 0.0, parts.home)
        mujoco.mj_forward(model, data)
        at, k = indices(model, parts), len(parts.actuators)
        self.scale(parts)
        command = np.zeros(len(self.command.limits))
        source = Source(model, data, parts, at, command, np.zeros(k), self.first_phase.copy())
        observer = Observer(self.observation, source)
        controller = self.controller((observer.size, k), model)
        seen = observer.observe()
        try:
            action = np.asarray(controller(seen), dtype=np.float64)
        except HcbfError:
            raise
        except Exception as error:  # a user's own function
            raise InvalidInputError(
                f"policy: {self.policy} raised {type(error).__name__}: {error}"
            ) from error
        if action.shape != (k,) or not np.isfinite(action).all():
            raise InvalidInputError(
                f"policy: got {action.tolist()} at the start, expected {k} finite numbers, one for "
                f"each of {list(parts.actuators)}"
            )


def _response_file(contract: Path) -> Path:
    return contract.with_suffix(".response.json")


def _find(path: str | Path) -> Path:
    """Return a contract's file."""
    if not isinstance(path, str | Path):
        raise InvalidInputError(
            f"robot: got {shown(path)}, expected a contract's path or one of {list(NAMES)}"
        )
    if str(path) in NAMES:
        return NAMES[str(path)]
    if isinstance(path, str) and not path.endswith(".json"):
        a1 = "; the A1, which takes accelerations, is 'HCBF-A1Regions-v0'" if path == "a1" else ""
        raise UnknownNameError(
            f"unknown robot: got {path!r}, expected a contract's path, which ends in .json, or one "
            f"of {list(NAMES)}{a1}"
        )
    file = Path(_expanded("robot", str(path)))
    if not file.is_file():
        raise InvalidInputError(f"robot: got {str(path)!r}, expected an existing JSON file")
    return file.resolve()


def _read(file: Path) -> Walker:
    """Return the contract in a file; nothing is checked against other files."""
    data = records.read_json("robot", file)
    what = f"walker ({file})"
    records.check_mapping(what, data)
    keys = [f.name for f in fields(Walker) if f.name not in ("source", "response")]
    missing = [key for key in keys if key not in data and key not in _OPTIONAL]
    unknown = sorted(set(data) - set(keys))
    if missing or unknown:
        raise InvalidInputError(
            f"{what}: got missing key(s) {missing} and unknown key(s) {unknown}, expected the keys "
            f"{keys}"
        )
    values: dict[str, Any] = dict(_OPTIONAL)
    for key, part in _PARTS.items():
        if data.get(key) is not None:
            records.check_mapping(f"{what}: {key}", data[key])
            values[key] = records.build(f"{what}: {key}", part, data[key])
        elif key in data and key not in _OPTIONAL:
            raise InvalidInputError(f"{what}: {key}: got None, expected a mapping")
    texts = {key: _text(f"{what}: {key}", data[key]) for key in ("name", "mjcf", "policy")}
    period = finite_float(
        f"{what}: period", data["period"], minimum=0.0, maximum=SLOWEST_PERIOD, exclusive=True
    )
    beside = _response_file(file)
    response = Response.load(beside) if beside.is_file() else None
    if response is not None:
        response.gains(len(values["command"].limits))  # fit
    return Walker(
        name=texts["name"],
        mjcf=file.parent / _expanded(f"{what}: mjcf", texts["mjcf"]),
        policy=_expanded(f"{what}: policy", texts["policy"]),
        period=period,
        observation=read_terms(data["observation"]),
        source=file,
        response=response,
        **values,
    )


def _text(what: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise InvalidInputError(f"{what}: got {value!r}, expected text")
    return value


def _expanded(what: str, path: str) -> str:
    """Return a path of the contract with its environment variables put in."""
    try:
        return records.expanded(what, path)
    except InvalidInputError as error:
        raise RobotModelError(str(error)) from error
