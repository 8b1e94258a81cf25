"""A snapshot in HTML, in which every value has an attribute `data-reading` with its name."""

from html import escape

from hcbf_gym.drawing.palette import priority_color
from hcbf_lab.play.report import Snapshot

STYLE = """<style>@media (max-width: 576px) {
.mantine-Paper-root:has([data-reading]) { width: 100% !important; max-height: 42% !important; }
.mantine-Paper-root:has([data-reading]) [style*="20em"] { width: 100% !important; }
.hcbf-details { display: none; }
}</style>"""
"""On a phone, viser's panel is as wide as the screen, and the scene has the upper half."""

_GREEN, _ORANGE, _RED, _GREY = "#2e7d32", "#b26a00", "#c0392b", "#555555"
_STATUS_COLORS = {
    "NOMINAL": _GREEN, "SAFE": _GREEN, "RELAXED": _ORANGE,
    "VIOLATED": _RED, "UNSAFE": _RED, "BACKUP": _RED,
}  # fmt: skip
_LABELS = {
    "intervention": "the filter changes the input by",
    "speed margin": "below the speed limit by",
    "margin": "distance reserved",
    "model error": "the robot moves",
    "reachable": "the way",
    "position": "at",
}
"""The words before those readings that are one line together."""


def html(snapshot: Snapshot, steering: str) -> str:
    """Return the readings of a snapshot; `steering` states in words which browser steers."""
    color = _STATUS_COLORS.get(snapshot.status, _GREY)
    ranks = "".join(_rank_row(snapshot, rank) for rank in snapshot.h)
    speed_margin = snapshot.speed_margin
    in_line = {
        "intervention": f"{snapshot.intervention:.2f} m/s²",
        "speed margin": "no limit" if speed_margin is None else f"{speed_margin:+.2f} m/s",
        **snapshot.details,
        "position": f"{snapshot.position[0]:.2f}, {snapshot.position[1]:.2f} m",
    }
    line = " · ".join(f"{_LABELS[name]} {_span(name, text)}" for name, text in in_line.items())
    settings = snapshot.settings
    state = "running" if snapshot.running else "paused"
    return (
        '<div style="padding:0 0.8em;font-size:0.85em;line-height:1.45">'
        f'<div><b style="color:{color}">{_span("status", snapshot.status)}</b> '
        f"{_span('sentence', snapshot.sentence)}</div>"
        f'<div style="color:#777">{_span("conflict", snapshot.conflict)}</div>'
        '<table style="width:100%;text-align:right"><tr style="color:#777">'
        "<td></td><td>distance now</td><td>least</td><td>relaxed by</td></tr>"
        f"{ranks}</table>"
        f'<div class="hcbf-details" style="color:#777">{line}</div>'
        f"<div>{_span('policy', settings.policy)} under {_span('program', settings.program)} in "
        f"{_span('scene', snapshot.scenario.name)}</div>"
        f"<div>t = {_span('time', f'{snapshot.time:.2f}')} s, {_span('state', state)}, "
        f"{_span('pace', f'{snapshot.pace:.2f}')} × real time; {_span('steering', steering)}</div>"
        f'<div style="font-weight:600">{_span("message", snapshot.message)}</div></div>'
    )


def _rank_row(snapshot: Snapshot, rank: int) -> str:
    """Return the row of a rank in the table: h, the least h, and the slack."""
    return (
        f'<tr><td style="color:{priority_color(rank)};font-weight:600">rank {rank}</td>'
        + _cell(f"h-{rank}", f"{snapshot.h[rank]:+.3f} m")
        + _cell(f"least-{rank}", f"{snapshot.least[rank]:+.3f} m")
        + _cell(f"slack-{rank}", f"{snapshot.slack.get(rank, 0.0):.2f} m/s²")
        + "</tr>"
    )


def _span(name: str, text: str) -> str:
    """Return a value, under the name by which tests and scripts find it."""
    return f'<span data-reading="{name.replace(" ", "-")}">{escape(text)}</span>'


def _cell(name: str, text: str) -> str:
    return f"<td>{_span(name, text)}</td>"
