"""The paper's figures 5, 6 and 7, on the reduced-order model and on the A1, with its claims."""

from functools import partial

from hcbf_lab.reproduction.figure5 import fig5
from hcbf_lab.reproduction.figures67 import fig6, fig7

OF_ROM = {"fig5": partial(fig5, model="rom")}
"""Figures of the reduced-order model; name → function (runs, folder, quick) → its claims."""
FIGURES = {"fig5": fig5, "fig6": fig6, "fig7": fig7}
"""All figures, which need the A1."""

__all__ = ["FIGURES", "OF_ROM", "fig5", "fig6", "fig7"]
