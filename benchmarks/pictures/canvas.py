"""Figures without a display, written to a folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt


@dataclass(frozen=True)
class Args:
    """Where the picture goes."""

    output: Path = Path("docs/images")
    """Its folder."""


def save(figure: Any, path: Path, dpi: int) -> None:
    """Write a figure and close it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(
        path, dpi=dpi, bbox_inches="tight" if figure.get_layout_engine() is None else None
    )
    plt.close(figure)
