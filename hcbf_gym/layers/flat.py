"""A filter of N states as a function of one array, with its derivative: both layers call it."""

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

_MARGINS = 3
_BUILT_IN = "shapes and speed limits of this package"


class Filtered(NamedTuple):
    """What a layer returns, with the leading axes of its arguments.

    Attributes:
        u: (…, 2) the filtered input, which has derivatives.
        status: (…,) `FilterStatus` as an integer.
        degenerate: (…,) whether u has no derivative here: slopes to either side differ. The
            derivative is then that of one side.
    """

    u: Any
    status: Any
    degenerate: Any


class FlatFilter:
    """u of the planar double integrator as a function of u*, x, the barriers' blocks and margins.

    Args:
        barriers: m of them, of built-in kinds; their numbers are defaults that a call may replace.
        input_set: U; the box |u_i| ≤ 5 unless given.
        program: one of `programs.names`, or a plan of your own.
        alpha1: α₁; the paper's logarithm unless given.
        alpha2: α₂; as `RowSettings` has it unless given.
        period: T of rows for a held input [s]; None makes the usual rows.
        alpha_speed: α of speed limits; as `RowSettings` has it unless given.
        options: of the program, see `programs.options`.

    Raises:
        InvalidInputError: on other barriers or malformed settings.

    Attributes:
        blocks: (m, 19) what `BarrierSet.parameters` holds, whose columns each shape names.
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
        kind, self._m = scene.kind[0], len(scene.kind[0])
        if (kind > layout.SPEED_LIMIT).any():
            place = int(np.argmax(kind > layout.SPEED_LIMIT))
            raise InvalidInputError(
                f"barriers: got number {place} of another kind, expected {_BUILT_IN}"
            )
        made = programs.make_batch(program, input_set=input_set, **options)
        settings = RowSettings(
            LogClassK() if alpha1 is None else alpha1,
            alpha2,
            period,
            made.input_set.radius,
            input_limits(made.input_set),
            alpha_speed,
        )
        check_limits(scene, period, made.input_set.radius)
        self.blocks = scene.parameters[0]
        core = _core.PlanarProgram(*made.settings_of(1).values())
        self._fixed = core, kind, scene.priority[0], settings.packed
        self._width = 6 + self._m * (layout.WIDTH + _MARGINS)

    def variables(self, xp: Any, u_nominal: Any, x: Any, blocks: Any, margin: Any, t: Any) -> Any:
        """Return (…, K) all of which u is a function, and t (…,), of arrays of the library `xp`.

        Args:
            xp: `torch` or `jax.numpy`.
            u_nominal: (…, 2) u*.
            x: (…, 4) position and velocity.
            blocks: (…, m, 19) the barriers' numbers.
            margin: (…, m, 3) m, ṁ and m̈ of each row.
            t: (…,) the time, of barriers that move [s].

        Raises:
            InvalidInputError: on shapes that do not fit.
        """
        own = {
            "u_nominal": (2,),
            "x": (4,),
            "blocks": (self._m, layout.WIDTH),
            "margin": (self._m, _MARGINS),
            "t": (),
        }
        arrays = dict(zip(own, (u_nominal, x, blocks, margin, t), strict=True))
        shapes = {name: tuple(array.shape) for name, array in arrays.items()}
        leading = []
        for name, shape in shapes.items():
            axes = len(shape) - len(own[name])
            if axes < 0 or shape[axes:] != own[name]:
                expected = ", ".join(map(str, own[name]))
                raise InvalidInputError(f"{name}: got shape {shape}, expected (..., {expected})")
            leading.append(shape[:axes])
        try:
            batch = np.broadcast_shapes(*leading)
        except ValueError as error:
            raise InvalidInputError(
                f"arguments: got shapes {shapes}, expected leading axes that broadcast"
            ) from error
        u, state, numbers, margins, times = (
            xp.broadcast_to(array, (*batch, *own[name])) for name, array in arrays.items()
        )
        of_barriers = xp.concatenate([numbers, margins], -1)
        flat = of_barriers.reshape((*batch, self._width - 6))
        return xp.concatenate([u, state, flat], -1), times

    def filter(self, variables: Array, t: Array) -> tuple[Array, Integers, Mask]:
        """Return u (…, 2), the statuses (…,) and where u has no derivative (…,).

        Args:
            variables: (…, K).
            t: (…,) the time, of barriers that move [s].

        Raises:
            InvalidInputError: on entries that are not finite.
        """
        flat, times = self._flat(variables, t)
        count, shape = len(flat), np.shape(variables)[:-1]
        u, status, degenerate = (
            np.empty((count, 2)),
            np.empty(count, np.int64),
            np.empty(count, bool),
        )
        bad = _core.layer_filter(*self._fixed, flat, times, u, status, degenerate)
        if bad < count:
            raise InvalidInputError(
                f"state {bad}: got u* {flat[bad, :2]}, x {flat[bad, 2:6]} and t {times[bad]} whose "
                "rows are not finite, expected finite numbers"
            )
        return u.reshape((*shape, 2)), status.reshape(shape), degenerate.reshape(shape)

    def pull_back(self, variables: Array, t: Array, w: Array) -> Array:
        """Return (∂u/∂variables)ᵀ w, (…, K), for w (…, 2)."""
        flat, times = self._flat(variables, t)
        out = np.empty_like(flat)
        weights = np.ascontiguousarray(w, np.float64).reshape(-1, 2)
        _core.layer_pull_back(*self._fixed, flat, times, weights, out)
        return out.reshape(np.shape(variables))

    def _flat(self, variables: Array, t: Array) -> tuple[Array, Array]:
        flat = np.ascontiguousarray(variables, np.float64).reshape(-1, self._width)
        return flat, np.ascontiguousarray(t, np.float64).reshape(-1)
