"""Draw what the weights γ₀ and Δγ change where the rows of ranks 2 and 3 oppose each other."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from benchmarks.pictures.canvas import Args, plt, save
from hcbf_gym import models, programs
from hcbf_gym.barriers import GeneralRows, HalfPlane, LinearClassK
from hcbf_gym.drawing.palette import priority_color

WALL = HalfPlane("wall", 1, normal=(0.0, 1.0), offset=-5.0)  # Far away: rank 1 decides nothing here
LAWN = HalfPlane("lawn", 2, normal=(1.0, 0.0), offset=0.3)
BED = HalfPlane("flower bed", 3, normal=(-1.0, 0.0), offset=0.9)
"""The robot, at rest in the origin, is inside both: h is −0.3 m and −0.9 m."""
ROWS = GeneralRows(models.DoubleIntegrator(), LinearClassK(1.0), LinearClassK(2.0))(
    [WALL, LAWN, BED], np.zeros(4)
)
U_NOMINAL = np.array([1.0, 0.0])
GAMMA0 = np.geomspace(0.02, 50.0, 60)
DELTA_GAMMA = np.linspace(0.0, 5.0, 60)


def main(args: Args) -> None:
    """Draw the picture."""
    by_gamma0 = [relaxations(gamma0=float(value), delta_gamma=0.0) for value in GAMMA0]
    by_delta = [relaxations(gamma0=1.0, delta_gamma=float(value)) for value in DELTA_GAMMA]
    locked = programs.make("lex-cbf-qp")(U_NOMINAL, ROWS).slack[1:]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(8.8, 3.3), sharey=True, layout="constrained"
    )
    panel(left, GAMMA0, np.array(by_gamma0), locked)
    left.set(
        xscale="log",
        xlim=(GAMMA0[0], GAMMA0[-1]),
        xlabel="$\\gamma_0$",
        ylabel="relaxation δ [m/s²]",
    )
    left.set_title("A price of any violation (Δγ = 0)", fontsize=10)
    panel(right, DELTA_GAMMA, np.array(by_delta), locked)
    right.set(xlabel="$\\Delta\\gamma$ [1/m]", xlim=(0.0, DELTA_GAMMA[-1]))
    right.set_title("A price that grows with the depth ($\\gamma_0$ = 1)", fontsize=10)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    save(figure, args.output / "weights.png", 110)
    print(f"lex-cbf-qp: {locked.round(2)}")
    for name, values in (("Δγ = 0", by_delta[0]), ("Δγ = 5", by_delta[-1])):
        print(f"r-cbf-qp, γ₀ = 1, {name}: {values.round(2)}")


def relaxations(gamma0: float, delta_gamma: float) -> NDArray[np.float64]:
    """Return (2,) how far R-CBF-QP violates the lawn's row and the bed's [m/s²]."""
    program = programs.make("r-cbf-qp", gamma0=gamma0, delta_gamma=delta_gamma)
    return program(U_NOMINAL, ROWS).slack[1:]


def panel(
    axes: Axes, weights: NDArray[np.float64], r: NDArray[np.float64], lex: NDArray[np.float64]
) -> None:
    """Draw δ of both ranks over a weight, under R- and under Lex-CBF-QP, which here uses none."""
    for k, barrier in enumerate((LAWN, BED)):
        label = f"{barrier.name}, rank {barrier.priority}"
        color = priority_color(barrier.priority)
        axes.plot(weights, r[:, k], color=color, linewidth=2.2, label=f"R-CBF-QP: {label}")
        axes.axhline(
            lex[k], color=color, linestyle=":", linewidth=1.8, label=f"Lex-CBF-QP: {label}"
        )
    axes.set_ylim(-0.1, 3.0)
    axes.grid(alpha=0.3)
