"""Readings over the last seconds: h and slack by rank, and the intervention."""

from collections import deque

import numpy as np
import viser
from viser import uplot

from hcbf_gym.drawing.palette import PATH, priority_color
from hcbf_lab.play.report import Snapshot

POINTS = 200
"""Points of a curve."""
_HEIGHT = 150


class Plots:
    """Three plots in a part of the page."""

    def __init__(self, server: viser.ViserServer, place: viser.GuiTabHandle):
        self._server, self._place = server, place
        self._ranks: tuple[int, ...] = ()
        self._seen: deque[tuple[float, ...]] = deque(maxlen=POINTS)
        self._charts: list[viser.GuiUplotHandle] = []

    def restart(self) -> None:
        """Forget what was."""
        self._seen.clear()

    def show(self, snapshot: Snapshot) -> None:
        """Add a point and draw."""
        if self._seen and self._seen[-1][0] >= snapshot.time:
            return
        ranks = tuple(snapshot.h)
        if ranks != self._ranks:
            self._lay_out(ranks)
        slack = [snapshot.slack.get(rank, 0.0) for rank in ranks]
        point = (snapshot.time, *snapshot.h.values(), *slack, snapshot.intervention)
        self._seen.append(point)
        time, *curves = np.array(self._seen).T
        count = len(ranks)
        parts = (curves[:count], curves[count : 2 * count], curves[2 * count :])
        for chart, part in zip(self._charts, parts, strict=True):
            chart.data = (time, *part)

    def _lay_out(self, ranks: tuple[int, ...]) -> None:
        for chart in self._charts:
            chart.remove()
        self._ranks = ranks
        self._seen.clear()
        of_ranks = [(f"rank {rank}", priority_color(rank)) for rank in ranks]
        with self._place:
            self._charts = [
                self._chart("h [m]", of_ranks),
                self._chart("slack [m/s²]", of_ranks),
                self._chart("intervention [m/s²]", [("‖u − u*‖", PATH)]),
            ]

    def _chart(self, title: str, curves: list[tuple[str, str]]) -> viser.GuiUplotHandle:
        empty = np.zeros(1)
        return self._server.gui.add_uplot(
            data=(empty,) * (1 + len(curves)),
            series=(
                uplot.Series(label="t [s]"),
                *(uplot.Series(label=name, stroke=color, width=2) for name, color in curves),
            ),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            title=title,
            height=_HEIGHT,
        )
