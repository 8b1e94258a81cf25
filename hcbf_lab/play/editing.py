"""Edits of a scene: one region is moved, resized or ranked anew, and a new scene is returned."""

import json
from collections.abc import Sequence
from dataclasses import replace

from hcbf_gym import scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Shape
from hcbf_gym.errors import InvalidInputError, choose, finite_array, finite_float
from hcbf_gym.scenarios import Scenario


def region(scenario: Scenario, name: str) -> Barrier:
    """Return the condition of a scene with this name."""
    return choose("region", name, {barrier.name: barrier for barrier in scenario.barriers})


def names(scenario: Scenario) -> list[str]:
    """Return the names of the regions that can be edited: those of built-in shapes."""
    return [barrier.name for barrier in scenario.barriers if isinstance(barrier, Shape)]


def position(barrier: Barrier, t: float = 0.0) -> Array:
    """Return the position (2,) of a region at time t [s]: its centre, or a point of a wall [m]."""
    shape = _shape(barrier)
    return shape.anchor + t * shape.frame_velocity


def size(barrier: Barrier) -> float | None:
    """Return the radius, or a similar length, of a region [m]; None for a wall."""
    return barrier.size if isinstance(barrier, Shape) else None


def move(scenario: Scenario, name: str, target: Sequence[float], t: float = 0.0) -> Scenario:
    """Return the scene with a region whose `position` at time t [s] is the target (2,) [m]."""
    barrier = region(scenario, name)
    step = finite_array(f"{name}: position", target, (2,)) - position(barrier, t)
    return _with_replaced(scenario, barrier, _shape(barrier).moved(step))


def resize(scenario: Scenario, name: str, new_size: float) -> Scenario:
    """Return the scene with a region of another size [m] and the same shape."""
    barrier = region(scenario, name)
    new_size = finite_float(f"{name}: size", new_size, minimum=0.0, exclusive=True)
    return _with_replaced(scenario, barrier, _shape(barrier).resized(new_size))


def rank(scenario: Scenario, name: str, priority: int) -> Scenario:
    """Return the scene with a region of another rank, and with ranks from 1 without gaps."""
    barrier = region(scenario, name)
    ranked = _with_replaced(scenario, barrier, replace(barrier, priority=priority)).barriers
    order = sorted({barrier.priority for barrier in ranked})
    without_gaps = (replace(b, priority=order.index(b.priority) + 1) for b in ranked)
    return replace(scenario, barriers=tuple(without_gaps))


def to_json(scenario: Scenario) -> bytes:
    """Return the scene as the content of a JSON file that ``scenario=`` takes."""
    return json.dumps(scenario.to_dict(), indent=2).encode()


def from_json(content: bytes) -> Scenario:
    """Return the scene of the content of a JSON file."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(f"scene file: it is no JSON ({error}), expected a scene") from error
    return scenarios.from_dict(data)


def _shape(barrier: Barrier) -> Shape:
    """Return a barrier if it can be edited, and refuse any other, such as a speed limit."""
    if isinstance(barrier, Shape):
        return barrier
    raise InvalidInputError(
        f"{barrier.name}: got a {type(barrier).__name__}, expected a region to move"
    )


def _with_replaced(scenario: Scenario, old: Barrier, new: Barrier) -> Scenario:
    """Return the scene with another barrier in the place of an old one."""
    return replace(scenario, barriers=tuple(new if b is old else b for b in scenario.barriers))
