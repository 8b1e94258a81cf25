"""The reproduction as a suite: the tables of docs/reproduction.md, and its pictures."""

from pathlib import Path
from typing import Any

from benchmarks.common import table
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.tables import Table
from hcbf_lab.reproduction import FIGURES
from hcbf_lab.reproduction.command import reproduce

FOLDER = Path("results")
"""Where the pictures go, in ``reproduce`` or, of a quick run, ``reproduce-quick``."""


def run(quick: bool) -> dict[str, Any]:
    """Draw all figures, and return the claims with the figures that they rest on."""
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
    shown = {
        "min h₃ [m]": "min_h3", "min h₄ [m]": "min_h4", "violation of h₄ [m·s]": "violation_of_h4",
        "tracking RMS [m]": "tracking_rms", "final error [m]": "final_error",
    }  # fmt: skip
    columns: Any = {"weights (γ₀, Δγ)": "{name} ({gamma0:g}, {delta_gamma:g})"} | {
        header: f"{{rom[{key}]:.2f}} / {{a1[{key}]:.2f}}" for header, key in shown.items()
    }
    rows = [
        rom | {"rom": rom, "a1": a1, "name": rom["program"][0].upper()}
        for rom, a1 in zip(on_model, on_robot, strict=True)
    ]
    return table("reduced-order model / A1", rows, columns)


def _episodes(episodes: dict[str, dict[str, Any]]) -> Table:
    columns = {
        "A1": "{name}", "steps touching the box": "{steps_touching_the_box}",
        "reaches the goal": lambda one: "yes" if one["reached"] else "no",
        "final error [m]": "{final_error:.2f}", "min h₃ [m]": "{min_h3:.3f}",
        "min h₄ [m]": "{min_h4:.2f}", "violation of h₄ [m·s]": "{violation_of_h4:.2f}",
    }  # fmt: skip
    return table("the experiment's course", _named(episodes), columns)


def _over_seeds(seeds: dict[str, dict[str, Any]]) -> Table:
    columns = {
        "A1, disturbed": "{name}", "episodes": "{episodes}", "touched the box": "{touched_the_box}",
        "reached the goal": "{reached}", "fell": "{fell}", "least h₃ [m]": "{least_h3:.3f}",
        "mean min h₄ [m]": lambda one: f"{sum(one['least_h4']) / len(one['least_h4']):.2f}",
        "mean violation of h₄ [m·s]": "{mean_violation_of_h4:.2f}",
    }  # fmt: skip
    return table("over seeds", _named(seeds), columns)


def _named(rows: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    return [{"name": name} | one for name, one in rows.items()]
