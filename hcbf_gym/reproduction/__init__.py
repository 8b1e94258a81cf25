"""The paper's figures 5, 6 and 7, on the reduced-order model and on the A1, with its claims."""

from hcbf_gym.reproduction.experiment import fig6, fig7
from hcbf_gym.reproduction.runs import Runs
from hcbf_gym.reproduction.simulation import fig5

FIGURES = {"fig5": fig5, "fig6": fig6, "fig7": fig7}
"""name → function (runs, folder, quick) that draws the figure and returns its claims."""

__all__ = ["FIGURES", "Runs", "fig5", "fig6", "fig7"]
