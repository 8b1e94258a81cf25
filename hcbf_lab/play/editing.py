"""A scene with one region moved, resized or ranked anew; every function returns another scene."""

import json
from collections.abc import Sequence
from dataclasses import replace

from hcbf_gym import scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Shape
from hcbf_gym.errors import InvalidInputError, choose, finite_array, finite_float
from hcbf_gym.scenarios import Scenario


def region(scenario: Scenario, name: str) -> Barrier:
    """Return the region of that name."""
    return choose("region", name, {barrier.name: barrier for barrier in scenario.barriers})


def names(scenario: Scenario) -> list[str]:
    """Return the names of what can be moved: built-in regions."""
    return [barrier.name for barrier in scenario.barriers if isinstance(barrier, Shape)]


def position(barrier: Barrier, t: float = 0.0) -> Array:
    """Return (2,) the handle of a region at time t: its centre, or a point of a wall [m]."""
    shape = _shape(barrier)
    return shape.anchor + t * shape.frame_velocity


def size(barrier: Barrier) -> float | None:
    """Return a region's radius, or its like [m]; a wall has none."""
    return barrier.size if isinstance(barrier, Shape) else None


def move(scenario: Scenario, name: str, to: Sequence[float], t: float = 0.0) -> Scenario:
    """Return the scene with a region where it is `to` (2,) [m] at time t [s]."""
    barrier = region(scenario, name)
    target = finite_array(f"{name}: position", to, (2,))
    step = target - position(barrier, t)
    return _with(scenario, barrier, _shape(barrier).moved(step))


def resize(scenario: Scenario, name: str, new_size: float) -> Scenario:
    """Return the scene with a region of another size [m] and the same shape."""
    barrier = region(scenario, name)
    new_size = finite_float(f"{name}: size", new_size, minimum=0.0, exclusive=True)
    return _with(scenario, barrier, _shape(barrier).resized(new_size))


def rank(scenario: Scenario, name: str, priority: int) -> Scenario:
    """Return the scene with a region of another rank; ranks without a region close up."""
    barrier = region(scenario, name)
    ranked = replace(barrier, priority=priority)
    others = tuple(ranked if other is barrier else other for other in scenario.barriers)
    order = sorted({other.priority for other in others})
    return replace(
        scenario,
        barriers=tuple(replace(b, priority=order.index(b.priority) + 1) for b in others),
    )


def to_json(scenario: Scenario) -> bytes:
    """Return the scene as the JSON file that ``scenario=`` takes."""
    return json.dumps(scenario.to_dict(), indent=2).encode()


def from_json(content: bytes) -> Scenario:
    """Return the scene that a file holds."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(f"scene file: it is no JSON ({error}), expected a scene") from error
    return scenarios.from_dict(data)


def _shape(barrier: Barrier) -> Shape:
    """Return the barrier, if it is a region."""
    if isinstance(barrier, Shape):
        return barrier
    raise InvalidInputError(
        f"{barrier.name}: got a {type(barrier).__name__}, expected a region to move"
    )


def _with(scenario: Scenario, old: Barrier, new: Barrier) -> Scenario:
    return replace(scenario, barriers=tuple(new if b is old else b for b in scenario.barriers))
