"""A snapshot as plain text, in HTML; every reading carries its name in `data-reading`."""

from html import escape

from hcbf_gym.drawing.palette import priority_color
from hcbf_lab.play.report import Snapshot

STYLE = """<style>@media (max-width: 576px) {
.mantine-Paper-root:has([data-reading]) { width: 100% !important; max-height: 42% !important; }
.mantine-Paper-root:has([data-reading]) [style*="20em"] { width: 100% !important; }
.hcbf-details { display: none; }
}</style>"""
"""On a phone: viser's sheet is as wide as the screen and leaves the scene the upper half."""

_STATUS_COLORS = {
    "NOMINAL": "#2e7d32",
    "SAFE": "#2e7d32",
    "RELAXED": "#b26a00",
    "VIOLATED": "#c0392b",
    "UNSAFE": "#c0392b",
    "BACKUP": "#c0392b",
}


_TITLES = {
    "intervention": "the filter changes the input by",
    "speed margin": "below the speed limit by",
    "margin": "distance reserved",
    "model error": "the robot moves",
    "reachable": "the way",
    "position": "at",
}
"""What a reading is called where it needs words."""


def html(snapshot: Snapshot, steering: str) -> str:
    """Return the readings of a tick."""
    color = _STATUS_COLORS.get(snapshot.status, "#555555")
    ranks = "".join(
        f'<tr><td style="color:{priority_color(rank)};font-weight:600">rank {rank}</td>'
        f"{_cell(f'h-{rank}', f'{h:+.3f} m')}"
        f"{_cell(f'least-{rank}', f'{snapshot.least[rank]:+.3f} m')}"
        f"{_cell(f'slack-{rank}', f'{snapshot.slack.get(rank, 0.0):.2f} m/s²')}</tr>"
        for rank, h in snapshot.h.items()
    )
    limit = snapshot.speed_margin
    rest = {
        "intervention": f"{snapshot.intervention:.2f} m/s²",
        "speed margin": "no limit" if limit is None else f"{limit:+.2f} m/s",
        **snapshot.details,
        "position": f"{snapshot.position[0]:.2f}, {snapshot.position[1]:.2f} m",
    }
    others = " · ".join(f"{_TITLES[name]} {_span(name, text)}" for name, text in rest.items())
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
        f'<div class="hcbf-details" style="color:#777">{others}</div>'
        f"<div>{_span('policy', settings.policy)} under {_span('program', settings.program)} in "
        f"{_span('scene', snapshot.scenario.name)}</div>"
        f"<div>t = {_span('time', f'{snapshot.time:.2f}')} s, {_span('state', state)}, "
        f"{_span('pace', f'{snapshot.pace:.2f}')} × real time; {_span('steering', steering)}</div>"
        f'<div style="font-weight:600">{_span("message", snapshot.message)}</div></div>'
    )


def _span(name: str, text: str) -> str:
    return f'<span data-reading="{name.replace(" ", "-")}">{escape(text)}</span>'


def _cell(name: str, text: str) -> str:
    return f"<td>{_span(name, text)}</td>"
