"""What a filter believes of a plant: the state that it is told, or the last one, carried on.

A state that is not finite or too far away, of no time or too old is not believed: the model
propagates the last one that was, under the input that was applied since.
"""

import math
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Record, Records
from hcbf_gym.barriers import margins
from hcbf_gym.compilation import kernel, put
from hcbf_gym.errors import holds_numbers
from hcbf_gym.filtering.verdict import NEWS
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.plant import FIRST_ALARM, Reason
from hcbf_gym.models.reduced_order import double_integrator_step

_FLOAT = np.dtype(np.float64)
_ROUNDING = 1e-6
"""Of a covariance: how far its correlations may be from those of one."""
KNOWN_FAULTS = (0, *(int(reason) for reason in Reason if reason.lasts))
"""What an `Estimate.fault` may be."""
_SAME = 1e-9
"""Of a covariance: by how much one that does not grow may differ from that before."""
STATE, CLOCK, ALARM = int(Reason.STATE), int(Reason.CLOCK), int(FIRST_ALARM)


class State(NamedTuple):
    """What is told of one plant, and the state that was believed last; of N with a leading axis.

    Attributes:
        x: (n,) as the rows read it.
        model: (n,) the reduced-order model's own.
        lag: (n,) the body's minus the model's.
        covariance: (n, n) of x.
        believed: (n,) the last that was.
    """

    x: Array
    model: Array
    lag: Array
    covariance: Array
    believed: Array


@kernel(error_model="numpy", inline="always")
def look(plant: Record, state: State) -> int:
    """Return why a plant is not believed, 0 if it is; a state after none is news.

    Args:
        plant: a `plants.PLANT` record, written to.
        state: of it; where it is believed, it is remembered.
    """
    time = plant.time
    if plant.has_model == 0:
        put(state.model, state.x)
    reason = plant.fault if plant.fault < ALARM else 0
    if reason == 0 and not (_is_sound(state) and abs(plant.heading) <= FARTHEST):
        reason = STATE
    if reason == 0 and not np.isfinite(time):
        reason = CLOCK
    tells_time = plant.elapsed > 0.0 or time != 0.0
    if reason == 0 and plant.known and time <= plant.believed_at and tells_time:
        reason = CLOCK
    if reason != 0:
        plant.follows = 0
        return reason
    if plant.follows == 0:
        plant.news = NEWS
    put(state.believed, state.x)
    plant.believed_at = time
    plant.known = 1
    return 0


@kernel(error_model="numpy", inline="always")
def replace(plant: Record, state: State) -> None:
    """Write the state that was believed last, which the model has carried on, for the present."""
    put(state.x, state.believed)
    put(state.model, state.believed)
    state.lag[:] = 0.0
    state.covariance[:, :] = 0.0
    plant.time = plant.believed_at


@kernel(error_model="numpy")
def believe(plant: Record) -> int:
    """Return why a planar double integrator is not believed, 0 if it is; then its model carries on.

    Args:
        plant: a `plants.PLANT` record, written to.
    """
    state = State(plant.x, plant.model, plant.lag, plant.covariance, plant.believed)
    follows = plant.follows
    reason = look(plant, state)
    if reason == 0:
        _grow(plant, follows)
        return 0
    believed = plant.believed
    if plant.known and plant.elapsed > 0.0:
        carried = double_integrator_step(believed, plant.input, plant.elapsed, np.inf)
        plant.known = 1
        for value in carried:
            if not abs(value) <= FARTHEST:
                plant.known = 0
        if plant.known:
            believed[0], believed[1], believed[2], believed[3] = carried
    replace(plant, state)
    return reason


@kernel(error_model="numpy")
def believe_all(plants: Records, states: State, velocity_at: int, told: Records) -> bool:
    """Look at N plants of any model, write the reasons, and return whether there is one.

    Args:
        plants: (N,) `plants.PLANT`, written to.
        states: of them.
        velocity_at: where x holds the planar velocity, -1 for nowhere.
        told: (N,) `report.PLANT`, the reasons are written.
    """
    some = False
    for i in range(plants.size):
        plant = plants[i]
        state = state_of(states, i)
        told[i].reason = look(plant, state)
        some |= told[i].reason != 0
        for k in range(2):  # what is known of a speed, whatever the model
            plant.x[2 + k] = np.inf if velocity_at < 0 else state.x[velocity_at + k]
    return some


@kernel(error_model="numpy")
def replace_all(plants: Records, states: State, told: Records) -> None:
    """Write the states that models carried on where plants are not believed."""
    for i in range(plants.size):
        if told[i].reason != 0:
            replace(plants[i], state_of(states, i))


@kernel(error_model="numpy", inline="always")
def state_of(states: State, i: int) -> State:
    """Return what is told of plant i."""
    return State(
        states.x[i], states.model[i], states.lag[i], states.covariance[i], states.believed[i]
    )


@kernel(error_model="numpy")
def grow_all(plants: Records, told: Records, drift: Array, n_p: int) -> None:
    """Note by how much the covariance of the drift grows in one period; see `_grow`.

    Args:
        plants: (N,) `plants.PLANT`, written to, before this sample is remembered.
        told: (N,) `report.PLANT`.
        drift: (N, n, n) that covariance.
        n_p: how many states are the position.
    """
    for i in range(plants.size):
        if told[i].reason != 0:
            continue
        velocity = plants[i].covariance[2:, 2:]
        velocity[:, :] = 0.0
        if n_p == 2:
            velocity[:, :] = drift[i, :2, :2]
        else:
            velocity[0, 0] = velocity[1, 1] = margins.worst(drift[i], n_p)
        _grow(plants[i], plants[i].follows)


@kernel(error_model="numpy", inline="always")
def _grow(plant: Record, follows: int) -> None:
    """Note by how much the velocity's covariance grows in one period; a fix does not change that.

    Of a sample that follows none all of it is taken, as nothing is known of how it grows. One that
    is the same as before does not grow.
    """
    covariance, vague = plant.covariance, plant.vague
    if follows == 0:
        vague[:] = plant.growth = 0.0
    xx, xy, yy = covariance[2, 2], covariance[2, 3], covariance[3, 3]
    if xx + yy + vague[0] + vague[2] == 0.0:
        return  # the truth, as before
    changed = abs(xx - vague[0]) + abs(xy - vague[1]) + abs(yy - vague[2])
    grown = margins.growth_of(covariance, vague)
    if grown > 0.0 or changed <= _SAME * (xx + yy):
        plant.growth = grown
    vague[0], vague[1], vague[2] = xx, xy, yy


@kernel(error_model="numpy")
def _is_sound(state: State) -> bool:
    """Return whether a plant is where anything can be, and its covariance may be one."""
    near = are_near(state.x) and are_near(state.model) and are_near(state.lag)
    return near and is_covariance(state.covariance)


def real_numbers(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is one of finite real numbers; else None."""
    numbers = numbers_of(value, shape)
    return None if numbers is None or not np.isfinite(numbers).all() else numbers


def numbers_of(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is a real one of that shape; else None.

    Half precision holds no state, and what a mask hides is no number. Some of the numbers may be
    infinite or none.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value.copy()
    try:
        if np.ma.is_masked(value):
            return None
        array = np.asarray(value)
    except Exception:  # whatever a foreign object raises when it is asked for its numbers
        return None
    if not holds_numbers(array.dtype) or array.shape != shape:
        return None
    with np.errstate(all="ignore"):
        return array.astype(np.float64)


def real_number(value: object) -> float | None:
    """Return `value` as a float if it is one finite real number, or an array of one; else None."""
    if type(value) is float:
        return value if math.isfinite(value) else None
    number = real_numbers(value, ())
    number = real_numbers(value, (1,)) if number is None else number
    return None if number is None else float(number.item())


@kernel(error_model="numpy")
def are_near(values: Array) -> bool:
    """Return whether no entry is beyond `FARTHEST`; of what is not finite that is false, too."""
    near = True
    for value in values:
        near &= abs(value) <= FARTHEST
    return near


@kernel(error_model="numpy")
def is_covariance(matrix: Array) -> bool:
    """Return whether a matrix (n, n) is symmetric without negative eigenvalues, up to rounding.

    It is zero, or the correlations that are left of it have a Cholesky factor.
    """
    n = matrix.shape[0]
    zero = True
    for j in range(n):
        if not (matrix[j, j] >= 0.0 and np.isfinite(matrix[j, j])):
            return False
        for k in range(n):
            zero &= matrix[j, k] == 0.0
    if zero:  # the truth
        return True
    rest = np.empty((n, n))
    for j in range(n):
        for k in range(n):
            size = np.sqrt(matrix[j, j]) * np.sqrt(matrix[k, k])
            if not abs(matrix[j, k]) <= (1.0 + _ROUNDING) * size:
                return False
            if not abs(matrix[j, k] - matrix[k, j]) <= _ROUNDING * size:
                return False
            rest[j, k] = matrix[j, k] / size if size > 0.0 else 0.0
    for j in range(n):
        pivot = rest[j, j]
        if pivot < -_ROUNDING * n:
            return False
        for k in range(j + 1, n):
            if pivot <= _ROUNDING * n:
                if abs(rest[k, j]) > np.sqrt(_ROUNDING) * n:
                    return False
                continue
            factor = rest[k, j] / pivot
            for i in range(j + 1, n):
                rest[k, i] -= factor * rest[j, i]
    return True
