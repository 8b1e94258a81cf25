"""The paper's figures 5, 6 and 7, on the reduced-order model and on the A1, with its claims."""

from hcbf_lab.reproduction.figure5 import fig5
from hcbf_lab.reproduction.figures67 import fig6, fig7

FIGURES = {"fig5": fig5, "fig6": fig6, "fig7": fig7}
"""The function of each figure: (runs, folder, quick) → claims and their data."""

__all__ = ["FIGURES", "fig5", "fig6", "fig7"]
