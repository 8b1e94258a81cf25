"""How a walker follows the velocities that it is commanded: the numbers from which margins come.

Stops from full speed first, then random commands that change as hard as the robot brakes. Writes
NAME.response.json, which the contract's next reader takes, and a picture of commanded against done.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from hcbf_gym.errors import finite_float
from hcbf_gym.robots.walker import Walker
from hcbf_gym.robots.walker_response import Response
from hcbf_gym.studies.identification.identify import identify
from hcbf_gym.studies.identification.picture import plot

SHORTEST = 10.0
"""Of random commands [s]: less tells nothing."""


@dataclass(frozen=True)
class Args:
    """Which walker, and for how long."""

    contract: tyro.conf.Positional[str]
    """The contract's path, or a name of a walker of the package."""
    seconds: float = 60.0
    """How long it gets random commands [s]."""
    seed: int = 0
    """Decides them."""
    output: Path | None = None
    """Folder to write to; the contract's own if not given."""


def main(args: Args) -> None:
    """Measure, write, and say where the robot does not follow."""
    seconds = finite_float("seconds", args.seconds, minimum=SHORTEST)
    walker = Walker.load(args.contract)
    identified = identify(walker, seconds, args.seed)
    response = identified.response
    file = walker.response_file
    if args.output is not None:
        file = args.output / file.name
    response.save(file)
    picture = file.with_suffix(".png")
    plot(identified, walker.name, picture)
    console = Console()
    console.print(_table(walker, response))
    for complaint in response.complaints:
        console.print(f"does not follow: {complaint}")
    console.print(f"written to {file} and {picture}", soft_wrap=True)


def _table(walker: Walker, response: Response) -> Table:
    """Return the numbers with their units."""
    names = ("v", "ω") if walker.command.sideways is None else ("v_x", "v_y", "ω")
    half, often, almost = response.residual
    table = Table("measured", "", title=f"{walker.name}, {response.seconds:g} s")
    for name, gain in zip(names, response.gain, strict=True):
        table.add_row(f"gain of {name}", f"{gain:.2f}")
    table.add_row("time constant", f"{response.time_constant:.3f} s")
    table.add_row("delay", f"{response.delay:.3f} s")
    table.add_row("residual 50, 95, 99.9 %", f"{half:.3f}, {often:.3f}, {almost:.3f} m/s")
    table.add_row("sway while it follows, 99.9 %", f"{response.sway:.3f} m")
    table.add_row("residual that lasts, 99.9 %", f"{response.lasting:.3f} m/s")
    table.add_row("overshoot, 99.9 %", f"{response.overshoot:.3f} m/s")
    table.add_row("rise, 10 to 90 %", f"{response.rise:.2f} s")
    table.add_row("stops within", f"{response.stopping:.2f} m")
    table.add_row("brakes at", f"{response.braking:.2f} m/s²")
    table.add_row("falls", f"{response.falls}")
    return table
