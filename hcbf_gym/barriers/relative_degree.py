r"""Which derivative of h an input enters first, and which inputs enter it.

The relative degree r is the least number of times that h must be differentiated along
``ẋ = f(x) + g(x)u`` until an input appears: L_g ψ_{r−1} ≠ 0, at sampled states at which h is not
flat. Where it differs from 0 at some of them alone, h has no one relative degree, and is refused.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.errors import UNREADABLE, InvalidInputError, UnreachableError
from hcbf_gym.models.reduced_order import ReducedOrderModel

VANISHED = _core.VANISHED
"""Below it, relative to its size at sampled states, L_g ψ counts as zero."""

SAMPLES = 16


class Reach(NamedTuple):
    """How inputs reach a barrier."""

    degree: int  # r, the derivative of h that an input enters first
    inputs: Mask  # (n_u,) which inputs enter that derivative: those of the row
    reads: Mask  # (n,) which states h depends on
    size: float  # the largest |L_g ψ_{r−1}| at a state, the median over sampled states


class ReachedBarriers(NamedTuple):
    """Barriers, and how inputs reach each of them."""

    barriers: Sequence[Barrier]
    reaches: Sequence[Reach]


def samples(model: ReducedOrderModel) -> tuple[Array, Array]:
    """Return the sampled states (SAMPLES, n) and times (SAMPLES,)."""
    rng = np.random.default_rng(0)
    return rng.normal(size=(SAMPLES, model.n)), rng.uniform(0.0, 1.0, SAMPLES)


def first_reach(
    barrier: Barrier, model: ReducedOrderModel, gradients: Array, along_inputs: Iterable[Array]
) -> Reach:
    """Return the first derivative that an input enters.

    Args:
        barrier: whose h it is.
        model: ẋ = f(x) + g(x)u.
        gradients: (SAMPLES, n) ∇h.
        along_inputs: L_g ψ (SAMPLES, n_u) of ψ = h, then of its derivatives; entries that are
            not finite are left out.

    Raises:
        UnreachableError: if no input enters any of them.
        InvalidInputError: if one enters a derivative at some of the states alone.
    """
    gradients = np.where(np.isfinite(gradients), np.abs(gradients), 0.0)
    reads = (gradients > VANISHED * gradients.max(axis=1, keepdims=True)).any(axis=0)
    degree = 0
    for degree, looks in enumerate(along_inputs, 1):
        size = np.where(np.isfinite(looks), np.abs(looks), 0.0)
        inputs = np.asarray((size > VANISHED).any(axis=0))
        if inputs.any():
            largest = size.max(axis=1)
            sloping = gradients.max(axis=1) > 0.0
            missed = int((sloping & (largest <= VANISHED)).sum())
            if missed:
                raise InvalidInputError(
                    f"{barrier.name}: an input enters derivative {degree} of h at some sampled "
                    f"states and not at {missed} of {SAMPLES}, expected one relative degree "
                    "everywhere: conditions of one rank in the place of a minimum of such"
                )
            return Reach(degree, inputs, reads, float(np.median(largest[largest > VANISHED])))
    raise UnreachableError(
        f"{barrier.name}: no input of {model} enters its first {degree} derivatives at any of "
        f"{SAMPLES} sampled states, expected a relative degree up to {degree}"
        + ("" if degree != 2 else " (barriers.Function finds higher ones)")
    )


def reach_by_jets(barrier: Barrier, model: ReducedOrderModel) -> Reach:
    """Return how inputs reach a barrier that gives jets: by its first or second derivative.

    Raises:
        UnreachableError: if no input enters them, or the barrier returns no jet.
    """
    try:
        return _reach_by_jets(barrier, model)
    except UnreachableError:
        raise
    except UNREADABLE as error:
        raise UnreachableError(
            f"{barrier.name}: its jet is not made of finite numbers ({error}), expected a "
            "barriers.Jet of them"
        ) from error


def _reach_by_jets(barrier: Barrier, model: ReducedOrderModel) -> Reach:
    states, times = samples(model)
    jets = [barrier.jet(x, float(t)) for x, t in zip(states, times, strict=True)]

    def relative(gradient: Array, x: Array) -> Array:
        """Return L_g ψ relative to ‖∇ψ‖ ‖g‖, as jets come in any unit."""
        g = model.g(x)
        size = np.linalg.norm(gradient) * np.linalg.norm(g)
        return gradient @ g / size if size > 0.0 else np.zeros(model.n_u)

    def second(jet: Jet, x: Array) -> Array:
        turned = jet.hessian @ model.f(x) + model.f_jacobian(x).T @ jet.gradient
        return relative(turned + jet.gradient_rate, x)

    each = list(zip(jets, states, strict=True))
    gradients = np.array([jet.gradient for jet in jets])
    with np.errstate(all="ignore"):
        first = np.array([relative(jet.gradient, x) for jet, x in each])
        levels = (first if d == 1 else np.array([second(*one) for one in each]) for d in (1, 2))
        return first_reach(barrier, model, gradients, levels)
