"""The identity of a plant, by which certificates compare it."""

import functools
import hashlib
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

from hcbf_gym import records, sources
from hcbf_gym.arrays import Info
from hcbf_gym.certificates import identity
from hcbf_gym.certificates.introspection import attributes
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Plant, read

_COMPARED_AS_THEY_ARE = type(None), bool, int, float, str
"""Types of parts that an identity contains; other parts count by their type and hash."""
UNHASHABLE = "what cannot be hashed"
"""The key of the list of parts that cannot be hashed; no certificate has it, so none fits."""


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
    stated: dict[str, object] = {}
    if plant.declared is not None:
        stated = records.plain(dict(read(plant.declared, env, observation, info)))
        if not stated:
            raise InvalidInputError(
                f"plant: got declared {stated!r}, which any plant matches; expected a value that "
                "distinguishes it, or None"
            )
        if is_of_package(plant.declared):
            return stated
    return stated | identified(plant, env)


def identified(plant: Plant, env: Any) -> dict[str, object]:
    """Return a value or a hash for each part of a user's plant and its unwrapped environment."""
    parts: dict[str, Any] = {"environment": type(env)}
    parts |= {f"environment.{name}": value for name, value in attributes(env).items()}
    parts |= {
        field.name.replace("_", " "): getattr(plant, field.name)
        for field in fields(plant)
        if field.name not in ("covered", "declared")
    }
    if plant.input_set is None:
        parts["action space"] = env.action_space
    identities: dict[str, object] = {}
    unhashable = []
    for name, part in parts.items():
        if type(part) in _COMPARED_AS_THEY_ARE:
            identities[name] = part
            continue
        cls = part if isinstance(part, type) else type(part)
        try:
            identities[name] = f"{cls.__name__} {identity.of(part, name)}"
        except identity.UnhashableError as error:
            unhashable.append(str(error))
    if unhashable:
        identities[UNHASHABLE] = unhashable
    return identities


def robot_of(name: str, files: Iterable[Path]) -> str:
    """Return a robot's name in certificates: its own name and a hash of its files' contents."""
    digests = {hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    return f"{name} {hashlib.sha256(' '.join(sorted(digests)).encode()).hexdigest()[:16]}"


def is_of_package(reader: object) -> bool:
    """Return whether a reader of a plant is a function of this package, not of a user."""
    function = reader.func if isinstance(reader, functools.partial) else reader
    package = str(getattr(function, "__module__", "")).partition(".")[0]
    return callable(reader) and package in sources.NAMES


def same(one: object, other: object) -> bool:
    """Return whether two parts of plants have one identity; False if one cannot be hashed."""
    try:
        return one is other or identity.of(one) == identity.of(other)
    except identity.UnhashableError:
        return False
