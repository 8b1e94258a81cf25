"""Hamilton–Jacobi reachability on a grid, beside formula and search; needs hj_reachability."""

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.ground_truth.truths import RADIUS, REACH, disc, wall
from hcbf_gym.arrays import Array

FAR, FAST, SECONDS = 2.7, 3.3, 0.8  # ends of the grid [m], [m/s], and how far it looks ahead [s]
GRIDS = {False: ((21, 15), (31, 23)), True: ((11, 9), (15, 11))}  # quick → a coarse one, a fine one


def _value(h: Callable[[Any], Any], shape: tuple[int, int]) -> tuple[Any, Any]:
    """Return the grid of p and v, and the greatest least h that an input reaches on it."""
    hj: Any = importlib.import_module("hj_reachability")
    jnp: Any = importlib.import_module("jax.numpy")

    class Robot(hj.ControlAndDisturbanceAffineDynamics):
        """ẋ = (v, u); nothing disturbs it."""

        def __init__(self) -> None:
            bounds = [hj.sets.Box(-e, e) for e in (REACH * jnp.ones(2), jnp.zeros(1))]
            super().__init__("max", "min", *bounds)

        def open_loop_dynamics(self, state: Any, time: Any) -> Any:
            return jnp.concatenate([state[2:], jnp.zeros(2)])

        def control_jacobian(self, state: Any, time: Any) -> Any:
            return jnp.vstack([jnp.zeros((2, 2)), jnp.eye(2)])

        def disturbance_jacobian(self, state: Any, time: Any) -> Any:
            return jnp.zeros((4, 1))

    end = np.array([FAR, FAR, FAST, FAST])
    lattice = (*shape[:1] * 2, *shape[1:] * 2)
    make = hj.Grid.from_lattice_parameters_and_boundary_conditions
    grid = make(hj.sets.Box(-end, end), lattice)
    settings = hj.SolverSettings.with_accuracy(
        "high", hamiltonian_postprocessor=hj.solver.backwards_reachable_tube
    )
    value = h(grid.states[..., :2])
    return grid, hj.step(settings, Robot(), grid, 0.0, value, -SECONDS, progress_bar=False)


def beside_the_search(x: Array, quick: bool) -> dict[str, Any]:
    """Compare the grid's values of a disc with those of the search, at states (N, 4).

    The grid's error, for 99 % of the states, is the greater of two: of the wall on the same grid
    beside its formula, and of the disc between two grids. Within this band a state is undecided.
    """
    jax: Any = importlib.import_module("jax")
    coarse, fine = GRIDS[quick]

    def on(shape: tuple[int, int], h: Callable[[Any], Any]) -> Array:
        grid, value = _value(h, shape)
        return np.asarray(jax.vmap(grid.interpolate, (None, 0))(value, x))

    def outside(p: Any) -> Any:
        return jax.numpy.linalg.norm(p, axis=-1) - RADIUS

    searched, found = disc().value(x), on(fine, outside)
    errors = on(fine, lambda p: p[..., 0]) - wall().value(x), found - on(coarse, outside)
    band = float(np.quantile(np.abs(errors), 0.99, axis=1).max())
    decided = np.abs(found) > band
    return {
        "grid": list(fine), "band": band, "states": len(x), "decided": int(decided.sum()),
        "search_missed": int((decided & (found > 0.0) & (searched < 0.0)).sum()),
        "search_more": int((decided & (found < 0.0) & (searched >= 0.0)).sum()),
        "difference": float(np.abs(found - searched).max()),
    }  # fmt: skip
