"""What a plant says of itself, as certificates compare it."""

import functools
import hashlib
import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import compilation, records
from hcbf_gym.arrays import Info
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Plant, read

_PLAIN = bool, int, float, str, np.ndarray
"""What of an object's own is told."""


def declared(plant: Plant, env: Any, observation: object, info: Info) -> dict[str, object]:
    """Return what tells a plant from another one, in JSON's terms.

    A plant that declares nothing by itself is known by its environment's class, its model, U, its
    axle and braking where it has them, its period, its readers, its barriers where they are no
    reader, and a hash of the files in which environment and readers are written, with those of the
    user's own that they import.

    Args:
        plant: that a filter has.
        env: unwrapped.
        observation: the latest.
        info: the latest.

    Raises:
        InvalidInputError: if it declares nothing.
    """
    if plant.declared is not None:
        stated: Mapping[str, object] = read(plant.declared, env, observation, info)
        if not stated:
            raise InvalidInputError(
                f"plant: got declared {stated!r}, which any plant matches; expected what tells it "
                "from others, or None"
            )
        return records.plain(dict(stated))
    input_set = plant.input_set
    written = _written_in(type(env), plant.state, plant.barriers)
    parts = type(plant.model), plant.to_action, plant.from_action, plant.brake
    reached = compilation.reached(written | _written_in(*parts))
    files = written | {file for file in reached if not file.is_relative_to(compilation.PACKAGE)}
    said = {
        "environment": type(env).__name__,
        "model": type(plant.model).__name__,
        "states": plant.model.n,
        "inputs": plant.model.n_u,
        "input set": None if input_set is None else records.plain(input_set.to_dict()),
        "period": plant.period,
        "readers": [_named(plant.state), _named(plant.barriers)],
        "files": files_hash(files),
    }
    if plant.axle is not None:
        said["axle"] = plant.axle._asdict()
    if plant.braking is not None:
        said["braking"] = plant.braking
    if is_dataclass(plant.model):
        said["parameters of the model"] = _named(plant.model)
    if input_set is None:
        said["action space"] = str(env.action_space)
    return said


def robot_of(name: str, files: Iterable[Path]) -> str:
    """Return what certificates call a robot: its name, and a hash of what its files hold."""
    return f"{name} {files_hash(files)}"


def files_hash(files: Iterable[Path]) -> str:
    """Return a hash of what files hold, whatever they are called."""
    digests = {hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    return hashlib.sha256(" ".join(sorted(digests)).encode()).hexdigest()[:16]


def _named(thing: object) -> str:
    """Return what tells a function from others in the same files, and any other thing by itself."""
    code = getattr(thing, "__code__", None)
    if code is not None:
        return f"{code.co_name} in line {code.co_firstlineno}"
    if isinstance(thing, functools.partial):
        return _named([thing.func, *thing.args, *sorted(thing.keywords.items())])
    if isinstance(thing, Sequence) and not isinstance(thing, str):
        return f"[{', '.join(map(_named, thing))}]"
    if is_dataclass(thing):
        shown = (f.name for f in fields(thing) if f.repr)
        parts = (f"{name}={_named(getattr(thing, name))}" for name in shown)
        return f"{type(thing).__name__}({', '.join(parts)})"
    if type(thing).__repr__ is object.__repr__:  # which is where it lies in this process
        held = getattr(thing, "__dict__", {}).items()
        known = (f"{name}={_named(value)}" for name, value in held if isinstance(value, _PLAIN))
        return f"{type(thing).__qualname__}({', '.join(known)})"
    return repr(thing)


def _written_in(*things: Any) -> set[Path]:
    """Return the files in which classes and functions are written; none for what has none."""
    found = set()
    for thing in things:
        whole = thing.func if isinstance(thing, functools.partial) else thing
        for one in (whole, type(whole)):
            try:
                file = inspect.getsourcefile(one)
            except TypeError:  # an instance, or built in
                continue
            if file is not None and Path(file).is_file():
                found.add(Path(file))
                break
    return found
