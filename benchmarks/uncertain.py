"""Hostile policies on every model, with estimates that are off by as much as they declare.

The error of the estimate lies within κσ in position, velocity and heading. It is constant, turns
slowly, or jumps at each sample. A step counts as entered where a strict h of the true state is
below zero at one of ten instants of its hold, under a calm status, also after an alarm, which noise
raises.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import models
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier, Disc, Function, HalfPlane, SpeedLimit
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.autodiff import import_jax
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Estimate, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel
from hcbf_gym.programs import FilterStatus

ERRORS = ("constant", "turns", "jumps")
NAMES = ("planar", "drag", "single integrator", "unicycle", "bicycle", "own", "axle", "walker")
PERIOD, COUNT, EPISODE, INSTANTS, LOOKS = 0.05, 20, 100, 10, 8
WITHIN = 0.99  # Of κσ, that an error may be
CART = Axle(look_ahead=0.25, forward=0.8, turn=1.8, braking=1.5)
REGIONS = (
    HalfPlane("wall", 1, (-1.0, 0.0), -2.0),
    HalfPlane("side", 1, (0.0, 1.0), -2.0),
    Disc("post", 1, (-1.5, 1.0), 0.5),
)
AWAY = np.array([(-1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])  # From each of them, where most robots are
CAP = SpeedLimit("cap", 1, 1.2)


class Case(NamedTuple):
    """A model with its conditions and the uncertainty of its state."""

    model: ReducedOrderModel  # ẋ = f(x) + g(x)u
    limits: tuple[float, ...]  # (n_u,) the largest inputs
    deviations: tuple[float, ...]  # (n,) of the state
    barriers: Sequence[Barrier]  # of rank 1
    axle: Axle | None = None  # of a differential drive
    declared: Uncertainty = Uncertainty()  # what the plant is off its model


def boat() -> models.ControlAffine:
    """Return a boat with f and g, with other drag ahead than aside."""
    return models.ControlAffine(
        lambda x: np.array([x[2], x[3], -0.5 * x[2], -0.2 * x[3]]),
        lambda x: np.vstack([np.zeros((2, 2)), np.eye(2)]),
        n=4, n_u=2, velocity_at=2,
    )  # fmt: skip


def ahead(shape: HalfPlane | Disc) -> Function:
    """Return the distance of a point 0.3 m ahead of a vehicle, less what it needs to stop."""
    jnp = import_jax("ahead").numpy

    if isinstance(shape, HalfPlane):
        numbers = np.array([*shape.normal, shape.offset])
        away: Callable[..., Any] = lambda q, p: p[0] * q[0] + p[1] * q[1] - p[2]  # noqa: E731
    else:
        numbers = np.array([*shape.center, shape.radius])
        away = lambda q, p: jnp.hypot(q[0] - p[0], q[1] - p[1]) - p[2]  # noqa: E731

    def clear(x: Any, t: Any, p: Any) -> Any:
        point = x[:2] + 0.3 * jnp.stack([jnp.cos(x[2]), jnp.sin(x[2])])
        return away(point, p) - (0.4 * x[3] if x.shape[0] > 3 else 0.0)

    return Function(shape.name, 1, clear, parameters=numbers)


def cases() -> dict[str, Case]:
    """Return every model."""
    on_place, moving = (0.1, 0.1), (0.1, 0.1, 0.05, 0.05)
    vehicles = [ahead(region) for region in REGIONS]
    follows = Uncertainty(distance=0.03, per_velocity=0.3, per_lead=1.0, cap=0.25, speed=0.05)
    planar = DoubleIntegrator()
    every = (
        Case(planar, (2.0, 2.0), moving, (*REGIONS, CAP)),
        Case(DoubleIntegrator(drag=0.5), (2.0, 2.0), moving, (*REGIONS, CAP)),
        Case(models.SingleIntegrator(), (1.0, 1.0), on_place, REGIONS),
        Case(models.Unicycle(), (1.0, 1.5), (*on_place, 0.03), vehicles),
        Case(models.KinematicBicycle(rear=0.3), (1.5, 0.4), (*on_place, 0.03, 0.05), vehicles),
        Case(boat(), (2.0, 2.0), moving, (*REGIONS, CAP)),
        Case(planar, (1.5, 1.5), moving, (*REGIONS, SpeedLimit("cap", 1, 0.6)), CART),
        Case(planar, (2.0, 2.0), moving, (*REGIONS, CAP), None, follows),
    )
    return dict(zip(NAMES, every, strict=True))


class Truth:
    """N plants as they are."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self.case, self._rng = case, rng
        self.x = np.zeros((COUNT, case.model.n))
        self.heading = np.zeros(COUNT)

    def restart(self, mask: Mask) -> None:
        """Let the masked plants (N,) begin at rest."""
        for i in np.flatnonzero(mask):
            self.x[i] = 0.0
            self.x[i, :2] = self._rng.uniform(-0.4, 0.8, 2)
            self.heading[i] = self._rng.uniform(-np.pi, np.pi)
            if "θ" in (self.case.model.__doc__ or ""):
                self.x[i, 2] = self.heading[i]

    def hold(self, u: Array) -> Iterator[Array]:
        """Advance by a period under u (N, n_u), and return the states at its instants."""
        axle, step = self.case.axle, PERIOD / INSTANTS
        if axle is None:
            for _ in range(INSTANTS):
                self.x = self.case.model.steps_of(self.x, u, step)
                yield self.x
            return
        e = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=1)
        across = np.stack([-e[:, 1], e[:, 0]], axis=1)
        place = self.x[:, :2] - axle.look_ahead * e
        v = (e * self.x[:, 2:]).sum(axis=1) + PERIOD * (e * u).sum(axis=1)
        turning = (across * (self.x[:, 2:] + PERIOD * u)).sum(axis=1) / axle.look_ahead
        for _ in range(INSTANTS):
            self.heading = self.heading + 0.5 * step * turning
            e = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=1)
            place = place + step * v[:, None] * e
            self.heading = self.heading + 0.5 * step * turning
            e = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=1)
            across = np.stack([-e[:, 1], e[:, 0]], axis=1)
            self.x[:, :2] = place + axle.look_ahead * e
            self.x[:, 2:] = v[:, None] * e + axle.look_ahead * turning[:, None] * across
            yield np.column_stack([place, v[:, None] * e])  # what binds the axle


class Errors:
    """What N estimates are off by: κσ in a direction of the state."""

    def __init__(self, kind: str, size: Array, rng: np.random.Generator) -> None:
        self._kind, self._size, self._rng = kind, size, rng
        self._direction = self._drawn(COUNT)

    def restart(self, mask: Mask) -> None:
        """Draw new directions for the masked plants (N,)."""
        self._direction[mask] = self._drawn(int(mask.sum()))

    def next(self) -> Array:
        """Return (N, n) the errors of a sample."""
        if self._kind == "jumps":
            self._direction = self._drawn(COUNT)
        if self._kind == "turns":
            change = 0.02 * self._rng.normal(size=self._direction.shape)
            self._direction = _unit(self._direction + change)
        return WITHIN * self._direction * self._size

    def _drawn(self, count: int) -> Array:
        """Return unit vectors: half of them make a region seem farther away than it is."""
        rng = self._rng
        found = rng.normal(size=(count, len(self._size)))
        found[:, 2:] *= rng.choice([0.0, 1.0, 5.0], size=(count, 1))
        blind = rng.random(count) < 0.5
        away = rng.choice(AWAY, size=count)
        found[blind, :2], found[blind, 2:] = away[blind], 0.0
        if len(self._size) == 4:  # a part of it is the velocity's
            share = rng.choice([-0.5, 0.0, 0.5], size=(count, 1))
            found[blind, 2:] = (share * away)[blind]
        return _unit(found)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def core_of(case: Case) -> FilterCore:
    """Return the filter of N plants."""
    input_set = Box(-np.array(case.limits), case.limits)
    plant = Plant(
        case.model, case.barriers, lambda *_: None, input_set, period=PERIOD,
        uncertainty=case.declared, axle=case.axle,
    )  # fmt: skip
    settings = FilterSettings("lex-cbf-qp", "held", None, None, None, "warn", True, {})
    return FilterCore(plant, input_set, settings, COUNT)


def nearest(case: Case, x: Array, heights: Callable[[Array], Array]) -> Array:
    """Return (N, n_u) the corner of U that takes the least h lowest within `LOOKS` periods."""
    corners = np.array(np.meshgrid(*([-one, one] for one in case.limits)))
    inputs = corners.reshape(len(case.limits), 1, -1).T.repeat(COUNT, axis=1)
    ends = (case.model.steps_of(x, u, LOOKS * PERIOD) for u in inputs)
    worst = np.argmin([heights(end).min(axis=1) for end in ends], axis=0)
    return inputs[worst, 0]


class Count(NamedTuple):
    """What became of steps: those under a calm status, and those of them that entered."""

    steps: int
    calm: int
    entered: int
    least: float


def run(case: Case, error: str, steps: int, seed: int) -> Count:
    """Return what became of so many steps, `COUNT` at once."""
    rng = np.random.default_rng(seed)
    size = case.declared.confidence * np.array(case.deviations)
    truth, errors = Truth(case, rng), Errors(error, size, rng)
    covariance = np.tile(np.diag(np.square(case.deviations)), (COUNT, 1, 1))
    core, fresh = core_of(case), np.ones(COUNT, dtype=np.bool_)
    regions = [one for one in case.barriers if not isinstance(one, SpeedLimit)]

    def heights(x: Array, barriers: Sequence[Barrier] = case.barriers) -> Array:
        return np.stack([one.batch(x, np.zeros(len(x))).h for one in barriers], axis=1)

    done = calm_steps = entered = 0
    least, age = np.inf, np.zeros(COUNT)
    time = np.zeros(COUNT)
    while done < steps:
        if fresh.any():
            truth.restart(fresh)
            errors.restart(fresh)
            core.restart(fresh)
            age[fresh] = time[fresh] = 0.0
        heading = truth.heading.copy() if case.axle else None
        estimate = Estimate(truth.x + errors.next(), time.copy(), covariance, heading=heading)
        if fresh.any():
            core.begin(list(case.barriers), estimate, None, None)
        wanted = nearest(case, truth.x, lambda x: heights(x, regions))
        wild = rng.random(COUNT) < 0.2
        wanted[wild] = rng.uniform(-1.0, 1.0, wanted.shape)[wild] * case.limits
        u, report = core.step(wanted, list(case.barriers), estimate)
        calm = report["status"] <= FilterStatus.RELAXED
        low = np.full(COUNT, np.inf) if case.axle else heights(truth.x).min(axis=1)
        for x in truth.hold(u):
            low = np.minimum(low, heights(x).min(axis=1))
        entered += int((calm & (low < 0.0)).sum())
        least = min(least, float(low[calm].min(initial=np.inf)))
        calm_steps += int(calm.sum())
        done += COUNT
        age += 1
        time += PERIOD
        fresh = (age >= EPISODE) | (low < -0.2)
    return Count(done, calm_steps, entered, least)
