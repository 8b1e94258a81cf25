"""Draw the input plane at one conflicting state: the rows, U, and what each program chooses."""

from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from benchmarks.pictures.canvas import Args, plt, save
from hcbf_gym import programs
from hcbf_gym.drawing.palette import PRIORITY_COLORS, PROGRAM_COLORS
from hcbf_gym.models.input_sets import Box
from hcbf_gym.programs import CbfRows

U_NOMINAL = np.array([-3.5, -0.5])
INPUT_SET = Box.symmetric(5.0)
ROWS = CbfRows(
    a=np.array([[1.0, 0.2], [-0.4, 1.0], [-1.0, -0.7], [0.2, -1.0]]),
    b=np.array([0.5, -1.0, 2.0, 2.5]),
    h=np.array([0.3, -0.1, -0.2, -0.2]),
    priority=np.array([1, 2, 3, 4]),
)
CHOICES: dict[str, tuple[str, dict[str, Any], str]] = {
    "CBF-QP (infeasible: least violation of all)": ("cbf-qp", {}, "X"),
    "R-CBF-QP, γ₀ = 1": ("r-cbf-qp", {"gamma0": 1.0, "delta_gamma": 0.0}, "s"),
    "IH-CBF-QP, γ₀ = 1 (H with three rows)": (
        "ih-cbf-qp",
        {"gamma0": 1.0, "delta_gamma": 0.0},
        "D",
    ),
    "EH-CBF-QP, γ₀ = 1": ("eh-cbf-qp", {"gamma0": 1.0, "delta_gamma": 0.0}, "v"),
    "EH-CBF-QP, γ₀ = 100": ("eh-cbf-qp", {"gamma0": 100.0, "delta_gamma": 0.0}, "^"),
    "Lex-CBF-QP": ("lex-cbf-qp", {}, "*"),
}


def main(args: Args) -> None:
    """Draw the picture."""
    figure, axes = plt.subplots(figsize=(8.6, 5.6))
    limit = 6.0
    grid = np.linspace(-limit, limit, 401)
    x, y = np.meshgrid(grid, grid)
    for k, color in enumerate(PRIORITY_COLORS[: len(ROWS.b)]):
        value = ROWS.a[k, 0] * x + ROWS.a[k, 1] * y - ROWS.b[k]
        axes.contourf(x, y, value, levels=[-np.inf, 0.0], colors=[color], alpha=0.13)
        axes.contour(x, y, value, levels=[0.0], colors=[color], linewidths=2.0)
        label = f"row {k + 1}, priority {k + 1}" + (" (strict)" if k == 0 else "")
        axes.plot([], [], color=color, linewidth=2.0, label=f"{label}; excluded side shaded")
    axes.add_patch(Rectangle((-5.0, -5.0), 10.0, 10.0, fill=False, linestyle="--", label="U"))
    axes.plot(*U_NOMINAL, "o", color="0.3", markersize=9, label="u*")
    for label, (name, options, marker) in CHOICES.items():
        result = programs.make(name, input_set=INPUT_SET, **options)(U_NOMINAL, ROWS)
        size = 17 if marker == "*" else 9
        axes.plot(
            *result.u,
            marker,
            color=PROGRAM_COLORS[name],
            markersize=size,
            markeredgecolor="w",
            label=label,
        )
        paid = ", ".join(f"{slack:.2f}" for slack in result.slack)
        print(f"{label}: u = ({result.u[0]:.2f}, {result.u[1]:.2f}), slack {paid}")
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axes.set(xlabel="$u_x$ [m/s²]", ylabel="$u_y$ [m/s²]")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    save(figure, args.output / "input_plane.png", 110)
