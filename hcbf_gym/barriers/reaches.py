"""How inputs reach the barriers of a model, computed once for barriers that they reach alike."""

from hcbf_gym.barriers.barrier import Barrier, checked
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache
from hcbf_gym.barriers.relative_degree import Reach, reach_by_jets, samples
from hcbf_gym.barriers.shapes import SHAPES, HalfPlane
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, UnreachableError, in_words
from hcbf_gym.models.reduced_order import ReducedOrderModel

_BOUNDED = {*SHAPES} - {HalfPlane}
"""Shapes whose h depends on both coordinates of the position, whatever their numbers are."""


class Reaches:
    """Computes how inputs of a model reach barriers; of functions, the cache `functions` does."""

    def __init__(self, model: ReducedOrderModel, functions: FunctionCache) -> None:
        self._model, self._functions = model, functions
        self._sampled_state = samples(model)[0][0]
        self._known: dict[tuple[type[Barrier], bytes], Reach] = {}

    def reach_of(self, barrier: Barrier) -> Reach:
        """Return how inputs reach a barrier.

        Raises:
            InvalidInputError: if no input enters the first or second derivative of h, or the
                barrier is a speed limit and the model has no velocity.
        """
        if isinstance(barrier, Function):
            return self._functions.groups([[barrier]])[0].kernel.reaches[0]
        if isinstance(barrier, SpeedLimit) and self._model.velocity_at != 2:
            raise InvalidInputError(
                f"{barrier.name}: got a speed limit for {self._model}, expected a model with its "
                "velocity in x[2:4]"
            )
        cls = type(barrier)
        key = cls, b"" if cls in _BOUNDED else self._sloping_states(barrier)
        if key not in self._known:
            self._known[key] = reach_by_jets(barrier, self._model)
        return self._known[key]

    def _sloping_states(self, barrier: Barrier) -> bytes:
        """Return as a key which entries of ∇h differ from 0: barriers of one class may differ."""
        try:
            jet = barrier.jet(self._sampled_state, 0.0)
            jet = checked(barrier, jet, self._model.n, finite=False)
        except InvalidInputError as error:
            raise UnreachableError(in_words(error)) from error
        return (jet.gradient != 0.0).tobytes()
