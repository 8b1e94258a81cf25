r"""Whether an episode tests the conditions of rank 1: what u* would have done without the filter.

The functions read the values h (m,) of a plant's strict conditions on the position. A state is
inside a region if an entry of h is negative. A step *prevents an entry* if the filter changed the
nominal input u*, and u*, held for at most a second, would have led inside. An episode without such
a step is vacuous: any filter would have passed it.
"""

from collections.abc import Callable

import numpy as np

from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.reduced_order import ReducedOrderModel

HELD = (
    0.25,
    0.5,
    0.75,
    1.0,
)  # the times for which u* is held, after which the state is checked [s]
CHANGED = 1e-3  # ‖u − u*‖ above which the filter has changed an input, as a share of U's radius
USUAL_STEPS = 10.0  # a jump is longer than this number of usual steps
SHARE_OF_RANGE = 0.2  # a jump is longer than this share of the range of h in the episode

# (x (j, n), t (j,)) → (j, m) h of the strict conditions on the position, at j states
Strict = Callable[[Array, Array], Array]


def prevents_entry(
    model: ReducedOrderModel,
    input_set: InputSet,
    x: Array,
    time: float,
    strict: Strict,
    report: Info,
) -> bool:
    """Return whether the filter changed an input that would have led inside within a second.

    With φ_s(x, u) the model's state after an input u held for s seconds, and u* cut to U, it is

        ‖u − u*‖ > `CHANGED` max ‖U‖  and  min h(φ_s(x, u*), t + s) < 0 for an s in `HELD`.

    Args:
        model: the plant's reduced-order model, which has φ.
        input_set: U.
        x: (n,) the state before the step.
        time: t, the time of that state [s].
        strict: h of the strict conditions on the position.
        report: the filter's report of this step.
    """
    if not report["intervention"] > CHANGED * input_set.radius:
        return False
    nominal = input_set.project(np.asarray(report["u_nominal"], dtype=np.float64))
    states = np.array([model.step(x, nominal, duration) for duration in HELD])
    return bool((strict(states, time + np.array(HELD)) < 0.0).any())


def check_jumps(source: str, observed: list[Array], predicted: list[Array]) -> None:
    r"""Refuse an episode whose environment resets itself, so that the state jumps.

    Sample k shows h_k, and step k should lead to the model's prediction ĥ_k of h_{k+1}. With the
    errors e_k = ‖h_{k+1} − ĥ_k‖_∞ and the changes c_k = ‖h_{k+1} − h_k‖_∞, step k jumps if

    .. math:: e_k > \max(10 \max(\mathrm{med}\, e, \mathrm{med}\, c),
                        0.2 \max_i (\max_k h_{k,i} - \min_k h_{k,i}))

    where 10 is `USUAL_STEPS` and 0.2 is `SHARE_OF_RANGE`. Episodes of fewer than three steps are
    accepted, as their medians show nothing.

    Args:
        source: the environment's name, for the message.
        observed: K + 1 times h (m,), one for each sample.
        predicted: K times ĥ (m,), one for each step.

    Raises:
        InvalidInputError: if the step of the greatest error jumps.
    """
    if len(predicted) < 3:
        return
    h = np.array(observed)
    errors = np.abs(h[1:] - np.array(predicted)).max(axis=1)
    changes = np.abs(np.diff(h, axis=0)).max(axis=1)
    usual = max(np.median(errors), np.median(changes))
    range_of_h = np.ptp(h, axis=0).max()
    k = int(errors.argmax())
    if errors[k] > max(USUAL_STEPS * usual, SHARE_OF_RANGE * range_of_h):
        raise InvalidInputError(
            f"{source}: got a state that jumps in step {k + 1}, by {errors[k]:.3g} in h where "
            f"{usual:.3g} is usual, expected an episode that ends (terminated or truncated) rather "
            "than an environment that resets itself"
        )
