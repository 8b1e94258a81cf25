"""The record of a wrapper's arguments, from which Gymnasium's spec makes the wrapper again."""

from dataclasses import fields
from typing import Any

from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv

from hcbf_gym import programs, records
from hcbf_gym.barriers import class_k
from hcbf_gym.errors import InvalidInputError, in_words, instance
from hcbf_gym.filter.settings import FilterSettings


def record(wrapper: RecordConstructorArgs, env: object, kind: type, **arguments: Any) -> None:
    """Record a wrapper's arguments, from which Gymnasium makes it again.

    Args:
        wrapper: the wrapper.
        env: the environment that it is put around.
        kind: the class that `env` has to be of.
        **arguments: the wrapper's other arguments.

    Raises:
        InvalidInputError: if the environment is of another class, or an argument cannot be copied.
    """
    instance(f"{type(wrapper).__name__}: env", env, kind)
    try:
        RecordConstructorArgs.__init__(wrapper, **arguments)
    except Exception as error:  # a user's object that is copied raises anything
        raise InvalidInputError(
            f"{type(wrapper).__name__}: got an argument that cannot be copied ({in_words(error)}), "
            f"expected plain values, of {sorted(arguments)}"
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
    """Record a filter's arguments in JSON's terms, class-K functions as dicts.

    `others` are arguments of one of the two filters alone.
    """
    arguments = settings._asdict() | others
    arguments["program"] = programs.plain(settings.program)
    arguments["certificate"] = records.plain(certificate)
    if kind is VectorEnv:  # its filter takes no solver
        del arguments["solver"]
    for name, value in arguments.pop("options").items():
        is_class_k = type(value) in class_k.KINDS.values()
        arguments[name] = records.to_dict(value, class_k.KINDS) if is_class_k else value
    record(wrapper, env, kind, plant=plant, **arguments)


class SpecWithPlant(EnvSpec):
    """The spec of a filter with a `plant` argument, whose readers JSON cannot hold."""

    def to_json(self) -> str:
        """Raise an `InvalidInputError`."""
        raise InvalidInputError(
            "spec: got SafetyFilter(env, plant=…), whose readers are functions, expected an "
            "environment that brings its plant, so that JSON need not hold it: set self.plant = "
            "hcbf_gym.Plant(…) in its __init__, register it by gymnasium.register(id=…, "
            "entry_point='module:Class'), and use SafetyFilter(gymnasium.make(id))"
        )


def with_plant(spec: EnvSpec) -> SpecWithPlant:
    """Return a copy of a spec that refuses to become JSON."""
    return SpecWithPlant(**{f.name: getattr(spec, f.name) for f in fields(spec) if f.init})
