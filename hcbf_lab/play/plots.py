"""Plots over the last snapshots: h and slack by rank, and the intervention."""

from collections import deque

import numpy as np
import viser
from viser import uplot

from hcbf_gym.drawing.palette import PATH, priority_color
from hcbf_lab.play.report import Snapshot

MAX_POINTS = 200  # of a curve
PLOT_HEIGHT = 150  # [pixels]


class Plots:
    """Three plots in a tab of the page."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle):
        self._server, self._tab = server, tab
        self._ranks: tuple[int, ...] = ()
        # (time, h of each rank, slack of each rank, intervention)
        self._points: deque[tuple[float, ...]] = deque(maxlen=MAX_POINTS)
        self._plots: list[viser.GuiUplotHandle] = []

    def restart(self) -> None:
        """Remove all points."""
        self._points.clear()

    def show(self, snapshot: Snapshot) -> None:
        """Add a snapshot to the curves, if it is newer than the last point."""
        if self._points and self._points[-1][0] >= snapshot.time:
            return
        ranks = tuple(snapshot.h)
        if ranks != self._ranks:
            self._add_plots(ranks)
        slack = [snapshot.slack.get(rank, 0.0) for rank in ranks]
        point = snapshot.time, *snapshot.h.values(), *slack, snapshot.intervention
        self._points.append(point)
        time, *curves = np.array(self._points).T
        m = len(ranks)
        h_plot, slack_plot, intervention_plot = self._plots
        h_plot.data = (time, *curves[:m])
        slack_plot.data = (time, *curves[m : 2 * m])
        intervention_plot.data = (time, *curves[2 * m :])

    def _add_plots(self, ranks: tuple[int, ...]) -> None:
        """Replace the plots by empty ones with a curve for each of these ranks."""
        for plot in self._plots:
            plot.remove()
        self._ranks = ranks
        self._points.clear()
        rank_curves = [(f"rank {rank}", priority_color(rank)) for rank in ranks]
        with self._tab:
            self._plots = [
                self._add_plot("h [m]", rank_curves),
                self._add_plot("slack [m/s²]", rank_curves),
                self._add_plot("intervention [m/s²]", [("‖u − u*‖", PATH)]),
            ]

    def _add_plot(self, title: str, curves: list[tuple[str, str]]) -> viser.GuiUplotHandle:
        """Add an empty plot of curves (name, color) over time."""
        empty = np.zeros(1)
        return self._server.gui.add_uplot(
            data=(empty,) * (1 + len(curves)),
            series=(
                uplot.Series(label="t [s]"),
                *(uplot.Series(label=name, stroke=color, width=2) for name, color in curves),
            ),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            title=title,
            height=PLOT_HEIGHT,
        )
