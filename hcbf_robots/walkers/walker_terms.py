"""The observation of a walker's controller, as a list of named terms; `TERMS` takes your own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import InvalidInputError, RobotModelError, check_options, choose
from hcbf_robots.walkers.walker_model import Indices, Parts, as_slice
from hcbf_robots.walkers.walker_parts import names, numbers, spread

TOUCH = 5.0  # the least force with which a body counts as touched [N]


class Source(NamedTuple):
    """All that terms read: the simulation, and arrays that the controller changes in place."""

    model: mujoco.MjModel  # the compiled scene
    data: mujoco.MjData  # its state
    parts: Parts  # names of the robot's parts
    at: Indices  # indices of these parts in the scene
    command: Array  # (c,) the present command of the controller
    last_action: Array  # (k,) the last output of the controller
    phase: Array  # (p,) the present phases of the clock [rad]


Options = Mapping[str, Any]  # of a term, besides its name and scale


class Reading(NamedTuple):
    """One term that is bound to a scene."""

    size: int  # the number of its entries
    write: Callable[[Array], object]  # writes the present values into an array (size,)


@dataclass(frozen=True)
class Term:
    """One term of a contract's observation."""

    term: str  # a name in `TERMS`
    scale: tuple[float, ...]  # factors of its entries: one for all, or one for each
    options: Options  # the term's further options


def read_terms(value: object) -> tuple[Term, ...]:
    """Return the terms of the list in a contract.

    Raises:
        InvalidInputError: if it is no list of terms, or an option is missing, unknown or malformed.
    """
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        raise InvalidInputError(f"observation: got {value!r}, expected a list of terms")
    return tuple(_term(item) for item in value)


def _term(item: Any) -> Term:
    """Return one term, which a contract gives by its name or as a mapping."""
    given = {"term": item} if isinstance(item, str) else item
    records.check_mapping("observation", given)
    if "term" not in given:
        raise InvalidInputError(f"observation: got {given!r}, expected a 'term' in it")
    name = given["term"]
    kind = choose("term", name, TERMS)
    options = {key: value for key, value in given.items() if key not in ("term", "scale")}
    check_options(f"observation: {name}", options, (*kind.required, *kind.optional))
    for key in kind.required:
        if key not in options:
            raise InvalidInputError(f"observation: {name}: got no {key!r}, expected it")
    for key, value in options.items():
        if key == "bodies":
            options[key] = names(f"observation: {name}: {key}", value)
        elif not isinstance(value, str) or not value:
            raise InvalidInputError(f"observation: {name}: {key}: got {value!r}, expected a name")
    return Term(name, numbers(f"observation: {name}: scale", given.get("scale", 1.0)), options)


def sensors_of(terms: Sequence[Term]) -> set[str]:
    """Return the names of the sensors in the robot's file that terms read."""
    return {term.options["name"] for term in terms if term.term == "sensor"}


def add_touch_sensors(spec: mujoco.MjSpec, terms: Sequence[Term]) -> None:
    """Add sensors of the net force on the bodies whose contacts terms read; refuse other names."""
    bodies = [body.name for body in spec.bodies]
    for term in terms:
        for body in term.options.get("bodies", ()):
            if body not in bodies:
                raise RobotModelError(f"contacts: got no body {body!r}, expected among {bodies}")
            spec.add_sensor(
                name=_touch(body),
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                objname=body,
                intprm=(1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), _NET_FORCE, 1),
            )


_NET_FORCE = 3  # a contact sensor's reduction: the contacts' sum, in the world's axes


def _touch(body: str) -> str:
    return f"touch of {body}"


class Observer:
    """Writes an observation of `size` entries, term by term, from the present state.

    Raises:
        RobotModelError: if a term's part is not in the scene.
        InvalidInputError: if there are more scales than entries.
    """

    def __init__(self, terms: Sequence[Term], source: Source):
        readings = [TERMS[term.term].bind(source, term.options) for term in terms]
        self.size = sum(reading.size for reading in readings)
        scales = [
            spread(f"observation: {term.term}: scale", term.scale, reading.size)
            for term, reading in zip(terms, readings, strict=True)
        ]
        self._scale = np.concatenate(scales)
        self._scaled = bool((self._scale != 1.0).any())
        self._out = np.zeros(self.size)
        ends = np.cumsum([reading.size for reading in readings])
        self._writes = [
            (reading.write, self._out[end - reading.size : end])
            for reading, end in zip(readings, ends, strict=True)
        ]

    def observe(self) -> Array:
        """Return the observation (size,); the next call writes into the same array."""
        for write, part in self._writes:
            write(part)
        if self._scaled:
            self._out *= self._scale
        return self._out


def _copies(view: Array) -> Reading:
    """Return the reading that copies an array, which others change in place."""
    return Reading(view.size, lambda out: np.copyto(out, view))


def _sensor(s: Source, options: Options) -> Reading:
    index = s.model.sensor(options["name"]).id
    first, size = int(s.model.sensor_adr[index]), int(s.model.sensor_dim[index])
    return _copies(s.data.sensordata[first : first + size])


def _gravity(s: Source, options: Options) -> Reading:
    if "site" not in options:
        up = s.data.xmat[s.model.body(s.parts.trunk).id][6:]
    else:
        sites = [s.model.site(i).name for i in range(s.model.nsite)]
        if options["site"] not in sites:
            raise RobotModelError(
                f"gravity: got no site {options['site']!r}, expected among {sites}"
            )
        up = s.data.site_xmat[s.model.site(options["site"]).id][6:]
    return Reading(3, lambda out: np.negative(up, out))


def _linear_velocity(s: Source, options: Options) -> Reading:
    rotation = s.data.xmat[s.model.body(s.parts.trunk).id].reshape(3, 3)
    velocity = s.data.qvel[:3]
    return Reading(3, lambda out: np.dot(velocity, rotation, out))


def _angular_velocity(s: Source, options: Options) -> Reading:
    return _copies(s.data.qvel[3:6])


def _joints(s: Source, options: Options) -> Reading:
    at, home, qpos = _driven(s, "joints", s.at.q), s.parts.home[s.at.q - 7], s.data.qpos
    return Reading(len(s.at.q), lambda out: np.subtract(qpos[at], home, out))


def _rates(s: Source, options: Options) -> Reading:
    at, qvel = _driven(s, "rates", s.at.rate), s.data.qvel
    return Reading(len(s.at.rate), lambda out: np.copyto(out, qvel[at]))


def _driven(s: Source, term: str, at: Integers) -> Integers | slice:
    """Return indices of driven joints, as a slice if possible, which is read faster."""
    if not s.parts.joints:
        raise InvalidInputError(
            f"observation: got {term!r} and no driven joints, expected action: joints"
        )
    return as_slice(at)


def _last_action(s: Source, options: Options) -> Reading:
    return _copies(s.last_action)


def _command(s: Source, options: Options) -> Reading:
    return _copies(s.command)


def _phase(s: Source, options: Options) -> Reading:
    count = len(s.phase)
    if not count:
        raise InvalidInputError("observation: got 'phase' and no clock, expected phase: frequency")

    def write(out: Array) -> None:
        np.cos(s.phase, out[:count])
        np.sin(s.phase, out[count:])

    return Reading(2 * count, write)


def _state(s: Source, options: Options) -> Reading:
    nq = 7 + len(s.parts.home)
    qpos, qvel = s.data.qpos[:nq], s.data.qvel[: nq - 1]
    return Reading(2 * nq - 1, lambda out: np.concatenate((qpos, qvel), out=out))


def _contacts(s: Source, options: Options) -> Reading:
    starts = [s.model.sensor_adr[s.model.sensor(_touch(body)).id] for body in options["bodies"]]
    indices, sensors = np.add.outer(np.array(starts), np.arange(3)), s.data.sensordata

    def write(out: Array) -> None:
        force = sensors[indices]
        out[:] = (force * force).sum(axis=1) > TOUCH * TOUCH

    return Reading(len(starts), write)


class Kind(NamedTuple):
    """A kind of term."""

    bind: Callable[[Source, Options], Reading]
    required: tuple[str, ...] = ()  # the options that it must have
    optional: tuple[str, ...] = ()  # the options that it may have


TERMS: dict[str, Kind] = {
    "sensor": Kind(_sensor, required=("name",)),  # a sensor of the robot's file
    "gravity": Kind(
        _gravity, optional=("site",)
    ),  # (3,) its direction in a site's or the trunk's axes
    "linear_velocity": Kind(_linear_velocity),  # (3,) of the trunk's origin, in its axes [m/s]
    "angular_velocity": Kind(_angular_velocity),  # (3,) of the trunk, in its axes [rad/s]
    "joints": Kind(_joints),  # (k,) positions of the driven joints minus home [rad]
    "rates": Kind(_rates),  # (k,) their velocities [rad/s]
    "last_action": Kind(_last_action),  # (k,) the controller's last output
    "command": Kind(_command),  # (v, ω) or (v_x, v_y, ω) [m/s, rad/s]
    "phase": Kind(_phase),  # (2k,) cosines of the clock's phases, then their sines
    "state": Kind(_state),  # (nq + nv,) qpos and qvel of the robot
    "contacts": Kind(
        _contacts, required=("bodies",)
    ),  # (k,) 1 for a body that `TOUCH` or more touches
}
"""The kinds of terms that a controller may observe, by their names."""
