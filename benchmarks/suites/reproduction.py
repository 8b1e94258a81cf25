"""The reproduction as a suite: the tables of docs/reproduction.md, and its pictures."""

from pathlib import Path
from typing import Any

from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.tables import Table
from hcbf_lab.reproduction import FIGURES
from hcbf_lab.reproduction.command import reproduce

FOLDER = Path("results")
"""Where the pictures go, in ``reproduce`` or, of a quick run, ``reproduce-quick``."""


def run(quick: bool) -> dict[str, Any]:
    """Draw all figures, and return the claims with the figures that they rest on.

    Args:
        quick: fewer episodes.
    """
    folder = FOLDER / ("reproduce-quick" if quick else "reproduce")
    return reproduce(FIGURES, folder, quick, Runs(folder / "episodes"))


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the claims, figure 5's weights, figure 6's episodes, and those over the seeds."""
    fig5, fig6 = figures["figures"]["fig5"], figures["figures"]["fig6"]
    claims = [(text, "yes" if holds else "no") for text, holds in figures["claims"].items()]
    return {
        "claims": Table(
            f"{sum(figures['claims'].values())} of {len(claims)} claims hold",
            ("claim", "holds"),
            claims,
        ),
        "figure5": _weights(fig5["rom"], fig5["a1"]),
        "figure6": _episodes(fig6["episodes"]),
        "seeds": _over_seeds(fig6["seeds"]),
    }


def _weights(on_model: list[dict[str, Any]], on_robot: list[dict[str, Any]]) -> Table:
    header = (
        "weights (γ₀, Δγ)", "min h₃ [m]", "min h₄ [m]", "violation of h₄ [m·s]",
        "tracking RMS [m]", "final error [m]",
    )  # fmt: skip
    shown = ("min_h3", "min_h4", "violation_of_h4", "tracking_rms", "final_error")
    rows = [
        (
            f"{rom['program'][0].upper()} ({rom['gamma0']:g}, {rom['delta_gamma']:g})",
            *(f"{rom[key]:.2f} / {a1[key]:.2f}" for key in shown),
        )
        for rom, a1 in zip(on_model, on_robot, strict=True)
    ]
    return Table("reduced-order model / A1", header, rows)


def _episodes(episodes: dict[str, dict[str, Any]]) -> Table:
    header = (
        "A1", "steps touching the box", "reaches the goal", "final error [m]", "min h₃ [m]",
        "min h₄ [m]", "violation of h₄ [m·s]",
    )  # fmt: skip
    rows = [
        (
            name, str(one["steps_touching_the_box"]), "yes" if one["reached"] else "no",
            f"{one['final_error']:.2f}", f"{one['min_h3']:.3f}", f"{one['min_h4']:.2f}",
            f"{one['violation_of_h4']:.2f}",
        )
        for name, one in episodes.items()
    ]  # fmt: skip
    return Table("the experiment's course", header, rows)


def _over_seeds(seeds: dict[str, dict[str, Any]]) -> Table:
    header = (
        "A1, disturbed", "episodes", "touched the box", "reached the goal", "fell",
        "least h₃ [m]", "mean min h₄ [m]", "mean violation of h₄ [m·s]",
    )  # fmt: skip
    rows = [
        (
            name, str(one["episodes"]), str(one["touched_the_box"]), str(one["reached"]),
            str(one["fell"]), f"{one['least_h3']:.3f}",
            f"{sum(one['least_h4']) / len(one['least_h4']):.2f}",
            f"{one['mean_violation_of_h4']:.2f}",
        )
        for name, one in seeds.items()
    ]  # fmt: skip
    return Table("over seeds", header, rows)
