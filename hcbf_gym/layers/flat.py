"""The filter as a differentiable function of one array; the layers of PyTorch and JAX call it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core, programs
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.braking import check_limits
from hcbf_gym.barriers.class_k import ClassK, LogClassK
from hcbf_gym.barriers.many import Element
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.filter.settings import input_limits
from hcbf_gym.models.input_sets import InputSet

MARGIN_SIZE = 3  # the number of entries of a row's margin: m, ṁ and m̈
_STATE_SIZE = 2 + 4  # u* and x


class Filtered(NamedTuple):
    """The result of a layer, with the leading axes of its arguments.

    Attributes:
        u: (…, 2) the filtered input [m/s²], which has derivatives.
        status: (…,) `FilterStatus` as an integer.
        degenerate: (…,) whether u has no derivative here, because the slopes to either side differ.
            The derivative is then that of one side.
    """

    u: Any
    status: Any
    degenerate: Any


class FlatFilter:
    """The filter of the planar double integrator as a function of its variables and the time.

    The variables (…, K) are u* (2,) and x (4,), then the block (19,) and the margin (3,) of each
    of m barriers, so that K = 6 + 22 m. `barriers.layout` describes blocks.

    Args:
        barriers: m barriers of built-in kinds; their blocks are defaults that a call may replace.
        input_set: U; the box |u_i| ≤ 5 unless given.
        program: one of `programs.names`, or a plan of your own.
        alpha1: α₁; the paper's logarithm unless given.
        alpha2: α₂; the default of `RowSettings` unless given.
        period: T, for which rows assume that an input is held [s]; None makes the usual rows.
        alpha_speed: α of speed limits; the default of `RowSettings` unless given.
        options: the options of the program, see `programs.options`.

    Raises:
        InvalidInputError: on a barrier of another kind, or malformed settings.

    Attributes:
        blocks: (m, 19) the barriers' numbers, as `BarrierSet.parameters` has them.
    """

    def __init__(
        self,
        barriers: Sequence[Element],
        input_set: InputSet | None = None,
        program: programs.Named = "lex-cbf-qp",
        alpha1: ClassK | None = None,
        alpha2: ClassK | None = None,
        period: float | None = None,
        alpha_speed: ClassK | None = None,
        **options: Any,
    ) -> None:
        scene = BarrierSet([barriers])
        kind, m = scene.kind[0], len(scene.kind[0])
        is_other = kind > layout.SPEED_LIMIT
        if is_other.any():
            raise InvalidInputError(
                f"barriers: got number {int(np.argmax(is_other))} of another kind, expected shapes "
                "and speed limits of this package"
            )
        batch_program = programs.make_batch(program, input_set=input_set, **options)
        limits = batch_program.input_set
        settings = RowSettings(
            LogClassK() if alpha1 is None else alpha1,
            alpha2,
            period,
            limits.radius,
            input_limits(limits),
            alpha_speed,
        )
        check_limits(scene, period, limits.radius)
        self.blocks = scene.parameters[0]
        self._shapes = {  # of the arguments without leading axes
            "u_nominal": (2,),
            "x": (4,),
            "blocks": (m, layout.WIDTH),
            "margin": (m, MARGIN_SIZE),
            "t": (),
        }
        self._size = _STATE_SIZE + m * (layout.WIDTH + MARGIN_SIZE)  # K
        core = _core.PlanarProgram(*batch_program.settings_of(1).values())
        self._constants = core, kind, scene.priority[0], settings.packed  # as the core takes them

    def variables(self, xp: Any, u_nominal: Any, x: Any, blocks: Any, margin: Any, t: Any) -> Any:
        """Return the variables (…, K) and the times (…,) as arrays of the library `xp`.

        Args:
            xp: `torch` or `jax.numpy`.
            u_nominal: (…, 2) u*.
            x: (…, 4) position and velocity.
            blocks: (…, m, 19) the barriers' numbers.
            margin: (…, m, 3) m, ṁ and m̈ of each row.
            t: (…,) the time, for barriers that move [s].

        Raises:
            InvalidInputError: on shapes that do not fit.
        """
        arrays = dict(zip(self._shapes, (u_nominal, x, blocks, margin, t), strict=True))
        batch = self._leading_axes({name: tuple(array.shape) for name, array in arrays.items()})
        u_nominal, x, blocks, margin, t = (
            xp.broadcast_to(array, (*batch, *self._shapes[name])) for name, array in arrays.items()
        )
        per_barrier = xp.concatenate([blocks, margin], -1)  # (…, m, 22)
        flat = per_barrier.reshape((*batch, self._size - _STATE_SIZE))
        return xp.concatenate([u_nominal, x, flat], -1), t

    def _leading_axes(self, shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
        """Return the leading axes to which arguments of these shapes broadcast."""
        leading = []
        for name, shape in shapes.items():
            last_axes = self._shapes[name]
            count = len(shape) - len(last_axes)
            if count < 0 or shape[count:] != last_axes:
                expected = ", ".join(map(str, last_axes))
                raise InvalidInputError(f"{name}: got shape {shape}, expected (..., {expected})")
            leading.append(shape[:count])
        try:
            return np.broadcast_shapes(*leading)
        except ValueError as error:
            raise InvalidInputError(
                f"arguments: got shapes {shapes}, expected leading axes that broadcast"
            ) from error

    def filter(self, variables: Array, t: Array) -> tuple[Array, Integers, Mask]:
        """Return u (…, 2), the statuses (…,) and where u has no derivative (…,).

        Args:
            variables: (…, K).
            t: (…,) the time, for barriers that move [s].

        Raises:
            InvalidInputError: on entries that are not finite.
        """
        flat, times = self._flat(variables, t)
        count, batch = len(flat), np.shape(variables)[:-1]
        u, status = np.empty((count, 2)), np.empty(count, np.int64)
        degenerate = np.empty(count, bool)
        first_invalid = _core.layer_filter(*self._constants, flat, times, u, status, degenerate)
        if first_invalid < count:
            state = flat[first_invalid]
            raise InvalidInputError(
                f"state {first_invalid}: got u* {state[:2]}, x {state[2:6]} and "
                f"t {times[first_invalid]} whose rows are not finite, expected finite numbers"
            )
        return u.reshape((*batch, 2)), status.reshape(batch), degenerate.reshape(batch)

    def pull_back(self, variables: Array, t: Array, w: Array) -> Array:
        """Return the vector-Jacobian product (∂u/∂variables)ᵀ w, (…, K), for w (…, 2)."""
        flat, times = self._flat(variables, t)
        product = np.empty_like(flat)
        weights = np.ascontiguousarray(w, np.float64).reshape(-1, 2)
        _core.layer_pull_back(*self._constants, flat, times, weights, product)
        return product.reshape(np.shape(variables))

    def _flat(self, variables: Array, t: Array) -> tuple[Array, Array]:
        """Return variables (N, K) and times (N,), their leading axes joined to one of length N."""
        flat = np.ascontiguousarray(variables, np.float64).reshape(-1, self._size)
        return flat, np.ascontiguousarray(t, np.float64).reshape(-1)
