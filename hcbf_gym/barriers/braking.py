r"""Whether U can brake what α₁ and α₂ request, and by how much α₁ must shrink if not.

The model is the double integrator.

On ψ = 0 the robot approaches a strict region at the speed s = α₁(h), and the row requests the
deceleration

.. math:: D(s) = s\, α_1'(α_1^{-1}(s)),

for the paper's logarithm at most φ₁²φ₂/(φ₃ e), at s = φ₁; for a linear α₁ gain · s, the more the
faster. For ψ > 0 it requests less, whatever α₂ is. `docs/rows.md` proves it, and says how much more
the row of a held input requests.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout, zone
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.models.input_sets import InputSet

RESERVE = 0.1
"""Share of what U can do in its worst direction that single rows leave: for a second row that pulls
another way, and for the tolerance of the programs."""

SLOW = 0.15
"""A robot to which a speed limit leaves less hardly walks [m/s]."""

PLACES, BEYOND = 200, 4.0
"""How many distances from the region are sampled, up to this multiple of the hardest speed."""


def weakest(input_set: InputSet) -> float:
    """Return the radius of the largest ball around 0 in U, what it can do in any direction."""
    _, b = input_set.halfspaces()
    return max(0.0, float((-b).min()))


def requested(settings: RowSettings, fastest: float = np.inf) -> float:
    """Return the largest b of a strict row at a state with ψ ≥ 0, the deceleration it requests.

    The robot drives straight at the region. What the turn of the gradient takes of a held input
    beside a polygon's corner, where the robot is slow, does not count.

    Args:
        settings: α₁, α₂ and the hold.
        fastest: the greatest approach speed there can be; α₁ linear needs it.
    """
    alpha1 = settings.alpha1
    top = min(BEYOND * alpha1.hardest_speed, fastest)
    speed = np.linspace(0.0, top, PLACES + 1)[1:]  # s = α₁(h − m) on ψ = 0
    kept = np.array([alpha1.inverse(s) for s in speed])
    if settings.period is None or settings.u_max is None:
        return float(max(s * alpha1.derivative(k) for s, k in zip(speed, kept, strict=True)))
    period, u_max = settings.period, settings.u_max
    half = 0.5 * u_max * period**2
    end = kept - period * speed
    chord = np.array([alpha1.derivative(max(abs(e - half), abs(e + half))) for e in end])
    promised = alpha1.values(end - half) + chord * half
    rows = (speed - promised) / (period + 0.5 * chord * period**2)
    return float(rows.max())


def share(settings: RowSettings, brakes: float) -> float:
    """Return the greatest c in [0, 1] with which the robot can brake what c·α₁ requests.

    It is 1 where α₁ requests more the faster the robot is: what that is, only a scene can say.

    Args:
        settings: α₁, α₂ and the hold.
        brakes: with how much it stops [m/s²], of which `RESERVE` is left.
    """
    able = (1.0 - RESERVE) * brakes
    if np.isinf(settings.alpha1.hardest_speed) or requested(settings) <= able:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if requested(replace(settings, alpha1=settings.alpha1.scaled(middle))) <= able:
            low = middle
        else:
            high = middle
    return low


def stoppable(alpha1: ClassK, input_set: InputSet) -> float:
    """Return the greatest speed [m/s] from which U stops the robot where regions close in.

    Args:
        alpha1: α₁, whose slope at 0 says how close to a region the robot may be at this speed.
        input_set: U, of which `RESERVE` is left.
    """
    return 2.0 * (1.0 - RESERVE) * weakest(input_set) / alpha1.derivative(0.0)


def speed_left(v_max: object, margin: Any) -> Any:
    """Return the speed that a cap leaves the model, ``√(v_max² − 2 v_max · margin)`` [m/s].

    Args:
        v_max: the cap [m/s], a number or an array.
        margin: what its row reserves between h and zero [m/s].
    """
    return np.sqrt(np.maximum(0.0, v_max * (v_max - 2.0 * margin)))


class Shortcoming(NamedTuple):
    """Something that α₁, U and a speed limit cannot satisfy in some of N scenes.

    Attributes:
        what: in a word, so that it is said once.
        scenes: (N,) where.
        promised: whether rank 1 is satisfied all the same.
        says: a sentence with the numbers.
    """

    what: str
    scenes: Mask
    promised: bool
    says: str


class _Demands(NamedTuple):
    """What N scenes demand of a robot.

    Attributes:
        left: (N,) the speed that the strict speed limits, or the robot's motors, leave [m/s];
            infinite where nothing limits it.
        margin: (N,) what those reserve [m/s].
        moves: (N,) the speed of the fastest strict region [m/s].
        narrows: (N,) whether strict regions can close in on the robot: there are two, or a
            map.
        slows: (N,) whether there are strict speed zones.
    """

    left: Array
    margin: Array
    moves: Array
    narrows: Mask
    slows: Mask


def shortcomings(
    scenes: BarrierSet,
    alpha1: ClassK,
    input_set: InputSet,
    speed_margin: float,
    fastest: float = np.inf,
) -> list[Shortcoming]:
    """Return what cannot be satisfied in N scenes; an empty list where everything can.

    Args:
        scenes: the N scenes.
        alpha1: α₁.
        input_set: U.
        speed_margin: what the row of a speed limit reserves besides its own margin [m/s].
        fastest: the greatest speed where no limit stands [m/s].
    """
    scene = _look(scenes, speed_margin, fastest)
    able = (1.0 - RESERVE) * weakest(input_set)
    steep = alpha1.derivative(0.0)
    stopped = stoppable(alpha1, input_set)
    found = [_cannot_flee(scene), _hardly_walks(scene), _cannot_stop(scene, stopped, able)]
    found.append(_cannot_slow(scene, able))
    if np.isinf(alpha1.hardest_speed):
        found += [_knows_no_speed(scene), _cannot_brake(scene, steep, able)]
    return [one for one in found if one.scenes.any()]


def _look(scenes: BarrierSet, speed_margin: float, fastest: float) -> _Demands:
    strict = scenes.priority == 1
    caps = strict & (scenes.kind == layout.SPEED_LIMIT)
    maps = strict & (scenes.kind == layout.MAPPED)
    regions = strict & scenes.is_region
    v_max = scenes.parameters[..., layout.V_MAX]
    kept = scenes.own_margin + speed_margin
    left = np.where(caps, speed_left(v_max, kept), np.inf)
    w_x, w_y = np.moveaxis(scenes.parameters[..., : layout.VELOCITY_Y + 1], -1, 0)
    return _Demands(
        left=left.min(axis=1, initial=fastest),
        margin=np.where(caps, kept, 0.0).max(axis=1, initial=0.0),
        moves=np.where(regions, np.hypot(w_x, w_y), 0.0).max(axis=1, initial=0.0),
        narrows=(regions.sum(axis=1) > 1) | maps.any(axis=1),
        slows=(strict & (scenes.kind == layout.ZONES)).any(axis=1),
    )


def _cannot_flee(scene: _Demands) -> Shortcoming:
    where = scene.moves >= scene.left
    return Shortcoming(
        "flight",
        where,
        False,
        f"a strict region moves at {_most(scene.moves, where):.3g} m/s, and the robot has "
        f"{_least(scene.left, where):.3g} m/s after the margin of its speed limit; expected a "
        "higher v_max, so that it can step aside",
    )


def _hardly_walks(scene: _Demands) -> Shortcoming:
    where = (scene.left < SLOW) & (scene.margin > 0.0)
    return Shortcoming(
        "slowness",
        where,
        True,
        f"the speed limit leaves {_least(scene.left, where):.3g} m/s after its margin of "
        f"{_most(scene.margin, where):.3g} m/s; expected a higher v_max, or patience",
    )


def _cannot_stop(scene: _Demands, stopped: float, able: float) -> Shortcoming:
    where = scene.narrows & np.isfinite(scene.left) & (scene.left > stopped)
    return Shortcoming(
        "stopping",
        where,
        False,
        f"where strict regions close in, {able * _most(scene.left, where) / stopped:.3g} m/s² stop "
        f"the robot in time, and U has {able:.3g} with a tenth in reserve; expected a v_max "
        f"that leaves at most {stopped:.3g} m/s, or a flatter alpha1",
    )


def _cannot_slow(scene: _Demands, able: float) -> Shortcoming:
    return Shortcoming(
        "slowing",
        scene.slows & (able < zone.BRAKING),
        False,
        f"before a strict speed zone the robot brakes by {zone.BRAKING:.3g} m/s², and U has "
        f"{able:.3g} with a tenth in reserve; expected a larger U, or zones of a lower rank",
    )


def _knows_no_speed(scene: _Demands) -> Shortcoming:
    return Shortcoming(
        "speed",
        np.isinf(scene.left),
        False,
        "a linear alpha1 asks for more braking the faster the robot is, and the scene has no "
        "strict speed limit; expected v_max, or the logarithm",
    )


def _cannot_brake(scene: _Demands, steep: float, able: float) -> Shortcoming:
    speed = scene.left + scene.moves
    where = np.isfinite(speed) & (steep * speed > able)
    return Shortcoming(
        "braking",
        where,
        False,
        f"a linear alpha1 asks for {steep * _most(speed, where):.3g} m/s² of braking at the speed "
        f"limit, and U has {able:.3g} with a tenth in reserve; expected a gain of at most "
        f"{able / max(_most(speed, where), TINY):.3g}",
    )


def _most(values: Array, where: Mask) -> float:
    return float(values.max(initial=0.0, where=where))


def _least(values: Array, where: Mask) -> float:
    return float(values.min(initial=np.inf, where=where))
