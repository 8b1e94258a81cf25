r"""Which derivative of h an input enters first, and which inputs enter it.

The relative degree r is the least number of times that h must be differentiated along
``ẋ = f(x) + g(x)u`` until an input appears: L_g ψ_{r−1} ≠ 0, at sampled states at which h is not
flat. Where it differs from 0 at some of them alone, h has no one relative degree, and is refused.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, Jet, checked
from hcbf_gym.errors import InvalidInputError, UnreachableError, in_words
from hcbf_gym.models.reduced_order import ReducedOrderModel

VANISHED = _core.VANISHED
"""L_g ψ counts as zero below this multiple of its size at sampled states."""

_SAMPLES = 16  # states at which relative degrees are found


class Reach(NamedTuple):
    """How inputs reach a barrier."""

    degree: int  # r, the derivative of h that an input enters first
    inputs: Mask  # (n_u,) whether an input enters that derivative, and so the row
    reads: Mask  # (n,) whether h depends on a state
    size: float  # the largest entry of |L_g ψ_{r−1}|, its median over sampled states


class ReachedBarriers(NamedTuple):
    """Barriers, and how inputs reach each of them."""

    barriers: Sequence[Barrier]
    reaches: Sequence[Reach]


def samples(model: ReducedOrderModel) -> tuple[Array, Array]:
    """Return the states (S, n) and times (S,) at which relative degrees are found."""
    rng = np.random.default_rng(0)
    return rng.normal(size=(_SAMPLES, model.n)), rng.uniform(0.0, 1.0, _SAMPLES)


def first_reach(
    barrier: Barrier, model: ReducedOrderModel, gradients: Array, lie_derivatives: Iterable[Array]
) -> Reach:
    """Return how inputs reach a barrier, by the first derivative that an input enters.

    Args:
        barrier: the barrier, whose name is in messages.
        model: ẋ = f(x) + g(x)u.
        gradients: (S, n) ∇h at the sampled states; an entry that is not finite counts as 0.
        lie_derivatives: L_g ψ (S, n_u) of ψ = h, then of its first derivative, and so on.

    Raises:
        UnreachableError: if no input enters any of them.
        InvalidInputError: if one enters a derivative at some of the states alone.
    """
    slopes = np.where(np.isfinite(gradients), np.abs(gradients), 0.0)
    steepest = slopes.max(axis=1)  # (S,)
    reads = (slopes > VANISHED * steepest[:, None]).any(axis=0)
    degree = 0
    for degree, lie_derivative in enumerate(lie_derivatives, 1):
        sizes = np.where(np.isfinite(lie_derivative), np.abs(lie_derivative), 0.0)
        inputs = np.asarray((sizes > VANISHED).any(axis=0))
        if not inputs.any():
            continue
        largest = sizes.max(axis=1)  # (S,)
        is_missed = (steepest > 0.0) & (largest <= VANISHED)
        if is_missed.any():
            raise InvalidInputError(
                f"{barrier.name}: an input enters derivative {degree} of h at some sampled "
                f"states and not at {is_missed.sum()} of {_SAMPLES}, expected one relative degree "
                "everywhere: conditions of one rank in the place of a minimum of such"
            )
        return Reach(degree, inputs, reads, float(np.median(largest[largest > VANISHED])))
    remedy = " (barriers.Function finds higher ones)" if degree == 2 else ""
    raise UnreachableError(
        f"{barrier.name}: no input of {model} enters its first {degree} derivatives at any of "
        f"{_SAMPLES} sampled states, expected a relative degree up to {degree}{remedy}"
    )


def reach_by_jets(barrier: Barrier, model: ReducedOrderModel) -> Reach:
    """Return how inputs reach a barrier that has a `jet`, by its first or second derivative.

    Raises:
        UnreachableError: if no input enters them, or the barrier returns no jet.
    """
    try:
        return _reach_by_jets(barrier, model)
    except UnreachableError:
        raise
    except InvalidInputError as error:
        raise UnreachableError(in_words(error)) from error
    except Exception as error:  # a user's own barrier may raise anything
        raise UnreachableError(
            f"{barrier.name}: its jet is not made of finite numbers ({in_words(error)}), expected "
            "a barriers.Jet of them"
        ) from error


def _reach_by_jets(barrier: Barrier, model: ReducedOrderModel) -> Reach:
    states, times = samples(model)
    jets = [
        checked(barrier, barrier.jet(x, float(t)), model.n, finite=False)
        for x, t in zip(states, times, strict=True)
    ]

    def relative_lie_derivative(gradient: Array, x: Array) -> Array:
        """Return L_g ψ relative to ‖∇ψ‖ ‖g‖, because ψ may have any unit."""
        g = model.g(x)
        size = np.linalg.norm(gradient) * np.linalg.norm(g)
        return gradient @ g / size if size > 0.0 else np.zeros(model.n_u)

    def gradient_of_h_dot(jet: Jet, x: Array) -> Array:
        along_drift = jet.hessian @ model.f(x) + model.f_jacobian(x).T @ jet.gradient
        return along_drift + jet.gradient_rate

    def lie_derivatives() -> Iterator[Array]:
        pairs = list(zip(jets, states, strict=True))
        yield np.array([relative_lie_derivative(jet.gradient, x) for jet, x in pairs])
        yield np.array([relative_lie_derivative(gradient_of_h_dot(jet, x), x) for jet, x in pairs])

    gradients = np.array([jet.gradient for jet in jets])
    with np.errstate(all="ignore"):
        return first_reach(barrier, model, gradients, lie_derivatives())
