"""The observation of a walker's controller, which a contract lists as named terms.

`TERMS` maps each name to a function that binds the term to a scene; new terms are added there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, RobotModelError, check_options, choose
from hcbf_robots.walkers.walker_model import FREE_JOINT_SIZE, Indices, Parts, as_slice
from hcbf_robots.walkers.walker_parts import names, numbers, spread

TOUCH_FORCE = 5.0  # the least force with which a body counts as touched [N]


class Source(NamedTuple):
    """The simulation and the controller's arrays that terms read; all are changed in place."""

    model: mujoco.MjModel  # the compiled scene
    data: mujoco.MjData  # its state
    parts: Parts  # names of the robot's parts
    indices: Indices  # of these parts in the scene
    command: Array  # (c,) the present command of the controller
    last_action: Array  # (k,) the last output of the controller
    phase: Array  # (p,) the present phases of the clock [rad]


Options = Mapping[str, Any]  # of a term in a contract, besides its name and scale


class Reading(NamedTuple):
    """A term that is bound to a scene."""

    size: int  # number of entries
    write: Callable[[Array], object]  # writes the present values into an array (size,)


@dataclass(frozen=True)
class Term:
    """One term of a contract's observation."""

    term: str  # a name in `TERMS`
    scale: tuple[float, ...]  # factors of its entries: one for all, or one for each
    options: Options  # the term's further options


def read_terms(value: object) -> tuple[Term, ...]:
    """Return the terms of a contract's list.

    Raises:
        InvalidInputError: if it is no list of terms, or an option is missing, unknown or malformed.
    """
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        raise InvalidInputError(f"observation: got {value!r}, expected a list of terms")
    return tuple(_term(item) for item in value)


def _term(item: Any) -> Term:
    """Return one term, which a contract lists by its name or as a mapping."""
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
    """Return the names of the sensors in the robot's file that the terms read."""
    return {term.options["name"] for term in terms if term.term == "sensor"}


def add_touch_sensors(spec: mujoco.MjSpec, terms: Sequence[Term]) -> None:
    """Add a sensor of the net contact force to each body of the terms; refuse unknown bodies."""
    bodies = [body.name for body in spec.bodies]
    for term in terms:
        for body in term.options.get("bodies", ()):
            if body not in bodies:
                raise RobotModelError(f"contacts: got no body {body!r}, expected among {bodies}")
            spec.add_sensor(
                name=_touch_sensor(body),
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                objname=body,
                intprm=(1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), _NET_FORCE, 1),
            )


_NET_FORCE = 3  # a contact sensor's reduction: the contacts' sum, in the world's axes


def _touch_sensor(body: str) -> str:
    """Return the name of the sensor that is added for a body."""
    return f"touch of {body}"


class Observer:
    """Writes an observation of `size` entries, term by term, from the present state of a source.

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
        self._is_scaled = bool((self._scale != 1.0).any())
        self._out = np.zeros(self.size)
        ends = np.cumsum([reading.size for reading in readings])
        self._writes = [
            (reading.write, self._out[end - reading.size : end])
            for reading, end in zip(readings, ends, strict=True)
        ]

    def observe(self) -> Array:
        """Return the observation (size,); the next call writes into the same array."""
        for write, entries in self._writes:
            write(entries)
        if self._is_scaled:
            self._out *= self._scale
        return self._out


def _copies(view: Array) -> Reading:
    """Return a reading that copies an array, which the simulation or controller changes."""
    return Reading(view.size, lambda out: np.copyto(out, view))


def _sensor(source: Source, options: Options) -> Reading:
    index = source.model.sensor(options["name"]).id
    first, size = int(source.model.sensor_adr[index]), int(source.model.sensor_dim[index])
    return _copies(source.data.sensordata[first : first + size])


def _gravity(source: Source, options: Options) -> Reading:
    model, data = source.model, source.data
    if "site" in options:
        sites = [model.site(i).name for i in range(model.nsite)]
        if options["site"] not in sites:
            raise RobotModelError(
                f"gravity: got no site {options['site']!r}, expected among {sites}"
            )
        rotation = data.site_xmat[model.site(options["site"]).id]
    else:
        rotation = data.xmat[model.body(source.parts.trunk).id]
    up = rotation[6:]  # last row of the matrix: the world's z in the axes of the site or the trunk
    return Reading(3, lambda out: np.negative(up, out))


def _linear_velocity(source: Source, options: Options) -> Reading:
    rotation = source.data.xmat[source.model.body(source.parts.trunk).id].reshape(3, 3)
    velocity = source.data.qvel[:3]
    return Reading(3, lambda out: np.dot(velocity, rotation, out))


def _joints(source: Source, options: Options) -> Reading:
    _check_has_joints("joints", source)
    indices, qpos = source.indices.q, source.data.qpos
    home, driven = source.parts.home[indices - FREE_JOINT_SIZE], as_slice(indices)
    return Reading(len(indices), lambda out: np.subtract(qpos[driven], home, out))


def _rates(source: Source, options: Options) -> Reading:
    _check_has_joints("rates", source)
    driven, qvel = as_slice(source.indices.rate), source.data.qvel
    return Reading(len(source.indices.rate), lambda out: np.copyto(out, qvel[driven]))


def _check_has_joints(term: str, source: Source) -> None:
    if not source.parts.joints:
        raise InvalidInputError(
            f"observation: got {term!r} and no driven joints, expected action: joints"
        )


def _phase(source: Source, options: Options) -> Reading:
    count = len(source.phase)
    if not count:
        raise InvalidInputError("observation: got 'phase' and no clock, expected phase: frequency")

    def write(out: Array) -> None:
        np.cos(source.phase, out[:count])
        np.sin(source.phase, out[count:])

    return Reading(2 * count, write)


def _state(source: Source, options: Options) -> Reading:
    nq = FREE_JOINT_SIZE + len(source.parts.home)
    qpos, qvel = source.data.qpos[:nq], source.data.qvel[: nq - 1]
    return Reading(2 * nq - 1, lambda out: np.concatenate((qpos, qvel), out=out))


def _contacts(source: Source, options: Options) -> Reading:
    sensors = [source.model.sensor(_touch_sensor(body)).id for body in options["bodies"]]
    axes = np.add.outer(source.model.sensor_adr[sensors], np.arange(3))
    sensordata = source.data.sensordata

    def write(out: Array) -> None:
        force = sensordata[axes]
        out[:] = (force * force).sum(axis=1) > TOUCH_FORCE * TOUCH_FORCE

    return Reading(len(sensors), write)


class Kind(NamedTuple):
    """How a kind of term is bound to a scene, and the options that it takes."""

    bind: Callable[[Source, Options], Reading]
    required: tuple[str, ...] = ()  # options that a contract must give
    optional: tuple[str, ...] = ()  # options that it may give


TERMS: dict[str, Kind] = {
    "sensor": Kind(_sensor, required=("name",)),  # a sensor of the robot's file
    "gravity": Kind(_gravity, optional=("site",)),  # (3,) in the axes of a site or of the trunk
    "linear_velocity": Kind(_linear_velocity),  # (3,) of the trunk's origin, in its axes [m/s]
    # (3,) of the trunk, in its axes [rad/s]
    "angular_velocity": Kind(lambda source, options: _copies(source.data.qvel[3:6])),
    "joints": Kind(_joints),  # (k,) positions of the driven joints minus home [rad, m]
    "rates": Kind(_rates),  # (k,) velocities of the driven joints [rad/s, m/s]
    # (k,) the controller's last output
    "last_action": Kind(lambda source, options: _copies(source.last_action)),
    # (v, ω) or (v_x, v_y, ω) [m/s, rad/s]
    "command": Kind(lambda source, options: _copies(source.command)),
    "phase": Kind(_phase),  # (2p,) cosines of the clock's phases, then their sines
    "state": Kind(_state),  # (nq + nv,) MuJoCo's qpos and qvel of the robot
    # (b,) 1 for each body that is touched with `TOUCH_FORCE` or more, 0 for the others
    "contacts": Kind(_contacts, required=("bodies",)),
}
"""Name of a term → its kind; the comments describe the entries."""
