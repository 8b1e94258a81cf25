"""Arguments that every wrapper takes: an environment, and what its spec repeats."""

from dataclasses import fields
from typing import Any

from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv

from hcbf_gym import programs, records
from hcbf_gym.barriers import class_k
from hcbf_gym.errors import InvalidInputError, instance
from hcbf_gym.filter.settings import FilterSettings


def record(wrapper: RecordConstructorArgs, env: object, kind: type, **arguments: Any) -> None:
    """Record a wrapper's arguments, from which Gymnasium makes it again.

    Args:
        wrapper: whose arguments they are.
        env: what it is put around.
        kind: what `env` has to be.
        **arguments: all others.

    Raises:
        InvalidInputError: if the environment is none of its kind, or an argument cannot be copied.
    """
    instance(f"{type(wrapper).__name__}: env", env, kind)
    try:
        RecordConstructorArgs.__init__(wrapper, **arguments)
    except Exception as error:  # whatever an object raises that is copied
        raise InvalidInputError(
            f"{type(wrapper).__name__}: got an argument that cannot be copied ({error}), expected "
            f"plain values, of {sorted(arguments)}"
        ) from error


def record_filter(
    wrapper: RecordConstructorArgs,
    env: object,
    kind: type,
    plant: object,
    settings: FilterSettings,
    certificate: object,
    **others: Any,
) -> None:
    """Record a filter's arguments in JSON's terms; class-K functions as dicts."""
    asked = settings._asdict()
    kinds, options = class_k.KINDS, asked.pop("options")
    asked["program"] = programs.plain(settings.program)
    if kind is VectorEnv:  # which takes no solver
        del asked["solver"]
    asked |= {
        key: records.to_dict(value, kinds) if type(value) in kinds.values() else value
        for key, value in options.items()
    }
    record(
        wrapper, env, kind, plant=plant, certificate=records.plain(certificate), **asked, **others
    )


class SpecWithPlant(EnvSpec):
    """The spec of a filter that was given a plant, whose readers JSON cannot hold."""

    def to_json(self) -> str:
        """Refuse.

        Raises:
            InvalidInputError: always.
        """
        raise InvalidInputError(
            "spec: got SafetyFilter(env, plant=…), whose readers are functions, expected an "
            "environment that brings its plant, so that JSON need not hold it: set self.plant = "
            "hcbf_gym.Plant(…) in its __init__, register it by gymnasium.register(id=…, "
            "entry_point='module:Class'), and use SafetyFilter(gymnasium.make(id))"
        )


def with_plant(spec: EnvSpec) -> SpecWithPlant:
    """Return a spec of a filter that was given a plant."""
    return SpecWithPlant(**{f.name: getattr(spec, f.name) for f in fields(spec) if f.init})
