"""The identity of a plant: a mapping name → value or hash, by which certificates compare plants.

* `declared` returns the whole identity: the values that the plant states, and what `identified`
  returns.
* `identified` returns the part that is found without the plant's help: a value or a hash of each
  part of a user's plant and environment.
* `same` compares two parts alone. Hashes of objects are made in `identity`.
"""

import functools
import hashlib
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

from hcbf_gym import records, sources
from hcbf_gym.arrays import Info
from hcbf_gym.certificates.identity import UnhashableError
from hcbf_gym.certificates.identity import of as hash_of
from hcbf_gym.certificates.introspection import attributes
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Plant, read

_KEPT_TYPES = type(None), bool, int, float, str
"""An identity holds values of these types themselves, and of any other value its type and hash."""
_FIELDS_LEFT_OUT = "covered", "declared"
"""The fields of `Plant` that `identified` leaves out: a verdict, and what `declared` reads."""
UNHASHABLE = "what cannot be hashed"
"""The name of an identity's list of errors, one for each part that has no hash.

Such a part cannot be compared, so the plant must not be covered. `Frozen` makes no certificate of a
plant with this name, so that no certificate has a range for it. `judge` covers no plant with a name
that has no range, and its message shows the name with the errors.
"""


def declared(plant: Plant, env: Any, observation: object, info: Info) -> dict[str, object]:
    """Return name → value of all that identifies a plant, in JSON's terms.

    The package's own environments are identified by their arguments, because the package's version
    determines the rest. Any other plant is identified by the values that it declares, by the class
    and the attributes of its environment, and by every field of its `Plant`. An attribute counts as
    it is now. A reset may change it, so an environment has to be read before its first reset.

    Args:
        plant: the filter's plant.
        env: its environment, unwrapped.
        observation: the latest observation, for the reader of `Plant.declared`.
        info: the latest info, for the same.

    Raises:
        InvalidInputError: if the plant declares an empty mapping.
    """
    if plant.declared is None:
        return identified(plant, env)
    stated = records.plain(dict(read(plant.declared, env, observation, info)))
    if not stated:
        raise InvalidInputError(
            f"plant: got declared {stated!r}, which any plant matches; expected a value that "
            "distinguishes it, or None"
        )
    return stated if is_of_package(plant.declared) else stated | identified(plant, env)


def identified(plant: Plant, env: Any) -> dict[str, object]:
    """Return name → value or hash of each part of a user's plant and its unwrapped environment.

    If some parts cannot be hashed, the list of their errors has the name `UNHASHABLE`.
    """
    identity: dict[str, object] = {}
    errors = []
    for name, part in _parts_of(plant, env).items():
        try:
            identity[name] = part if type(part) in _KEPT_TYPES else _type_and_hash(part, name)
        except UnhashableError as error:
            errors.append(str(error))
    if errors:
        identity[UNHASHABLE] = errors
    return identity


def _parts_of(plant: Plant, env: Any) -> dict[str, Any]:
    """Return name → part of a plant and its unwrapped environment, which identify the plant."""
    parts: dict[str, Any] = {"environment": type(env)}
    parts |= {f"environment.{name}": value for name, value in attributes(env).items()}
    parts |= {
        field.name.replace("_", " "): getattr(plant, field.name)
        for field in fields(plant)
        if field.name not in _FIELDS_LEFT_OUT
    }
    if plant.input_set is None:  # then the action space is the set of inputs
        parts["action space"] = env.action_space
    return parts


def _type_and_hash(part: object, name: str) -> str:
    """Return the name of a part's type, or of the part if it is a type, and the part's hash."""
    cls = part if isinstance(part, type) else type(part)
    return f"{cls.__name__} {hash_of(part, name)}"


def robot_of(name: str, files: Iterable[Path]) -> str:
    """Return a robot's name in certificates: its own name and a hash of its files' contents."""
    digests = {hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    return f"{name} {hashlib.sha256(' '.join(sorted(digests)).encode()).hexdigest()[:16]}"


def is_of_package(reader: object) -> bool:
    """Return whether a reader of a plant is a function of this package, not of a user."""
    function = reader.func if isinstance(reader, functools.partial) else reader
    package = str(getattr(function, "__module__", "")).partition(".")[0]
    return callable(reader) and package in sources.NAMES


def same(part: object, other: object) -> bool:
    """Return whether two parts of plants are one object or have one hash.

    It is False if they are two objects, of which one cannot be hashed.
    """
    try:
        return part is other or hash_of(part) == hash_of(other)
    except UnhashableError:
        return False
