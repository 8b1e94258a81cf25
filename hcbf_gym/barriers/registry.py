"""The kinds of barriers by name, so that scenes travel through JSON; users add their own."""

from collections.abc import Mapping
from dataclasses import is_dataclass

from hcbf_gym import records
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, UnknownNameError, instance, shown

_KINDS: dict[str, type[Barrier]] = {
    **{shape.kind: shape for shape in SHAPES},
    SpeedLimit.kind: SpeedLimit,
}


def register(kind: str, barrier: type[Barrier]) -> None:
    """Name a class of barriers, so that scenes with it can be written to JSON and read back.

    Args:
        kind: the name in the file.
        barrier: a dataclass derived from `Barrier`, whose fields JSON can hold.

    Raises:
        InvalidInputError: if the name is empty or another class has it, or if the class is no
            dataclass derived from `Barrier`.

    Example:
        >>> from dataclasses import dataclass
        >>> import numpy as np
        >>> from hcbf_gym import barriers
        >>> @dataclass(frozen=True)
        ... class Ceiling(barriers.PlanarBarrier):
        ...     height: float = 1.0
        ...     def planar_jet(self, q):
        ...         return self.height - q[1], np.array([0.0, -1.0]), np.zeros((2, 2))
        >>> barriers.register("ceiling", Ceiling)
        >>> barriers.from_dict(barriers.to_dict(Ceiling("ceiling", 1, height=2.0))).height
        2.0
    """
    if not isinstance(kind, str) or not kind:
        raise InvalidInputError(f"barrier kind: got {shown(kind)}, expected non-empty text")
    if not (isinstance(barrier, type) and issubclass(barrier, Barrier) and is_dataclass(barrier)):
        raise InvalidInputError(
            f"barrier kind {kind!r}: got {shown(barrier)}, expected a dataclass derived from "
            "Barrier"
        )
    if _KINDS.get(kind, barrier) is not barrier:
        raise InvalidInputError(
            f"barrier kind {kind!r}: got {barrier.__name__}, expected a name that "
            f"{_KINDS[kind].__name__} does not have; taken: {sorted(_KINDS)}"
        )
    _KINDS[kind] = barrier


def to_dict(barrier: Barrier) -> dict[str, object]:
    """Return the barrier as a plain dict that `from_dict` reads and JSON can hold.

    Raises:
        InvalidInputError: if its class is not registered.
    """
    instance("barrier", barrier, Barrier)
    if type(barrier) not in _KINDS.values():
        raise InvalidInputError(
            f"barrier {barrier.name!r}: got a {type(barrier).__name__}, expected one of "
            f"{sorted(_KINDS)}: call hcbf_gym.barriers.register('a-name', {type(barrier).__name__})"
        )
    return records.to_dict(barrier, _KINDS)


def from_dict(data: Mapping[str, object]) -> Barrier:
    """Return the barrier that `to_dict` described.

    Raises:
        UnknownNameError: if its kind is not registered; the message lists those that are.
        InvalidInputError: if a field is missing, unknown or mistyped.
    """
    try:
        return records.from_dict("barrier", data, _KINDS)
    except UnknownNameError as error:
        raise UnknownNameError(
            f"{error}; hcbf_gym.barriers.register adds a class of your own"
        ) from error
