"""How a robot follows the velocities that it is commanded: the numbers from which margins come.

A contract's robot is driven in its simulation: stops from full speed first, then random commands
that change as hard as it brakes. With --log a drive of a real robot is read, a CSV file with the
columns time [s], cmd_vx, cmd_vy, cmd_w (a differential drive has no cmd_vy), and its pose x, y,
yaw or its twist vx, vy, w in its own axes, or both [m, m/s, rad, rad/s]. Writes NAME.response.json,
which the contract's next reader and `hcbf_robots.Response.load` take, and a picture of both.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

import hcbf_robots
from hcbf_gym.arguments import Folder, Positive, Range, Seed
from hcbf_gym.errors import InvalidInputError, finite_float, require_packages
from hcbf_robots.identification.analysis import Identified
from hcbf_robots.identification.log import identify_log
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response

SHORTEST, LONGEST = 10.0, 3600.0
"""Of random commands [s]: less shows nothing, and more nothing new."""
HERE = Path(hcbf_robots.__file__).resolve().parent
"""Where nothing is written: certificates are of the robots as they ship."""


@dataclass(frozen=True)
class Args:
    """Which robot, and for how long."""

    contract: tyro.conf.Positional[str] = ""
    """The contract's path, or a name of a walker of the package; none is needed with --log."""
    log: Path | None = None
    """CSV file of a drive, in place of a simulation."""
    look_ahead: Positive | None = None
    """Of a differential drive without a contract: how far before its axle the point lies that
    follows [m]."""
    seconds: Annotated[float, Range(SHORTEST, LONGEST)] = 60.0
    """How long it gets random commands [s]."""
    seed: Seed = 0
    """Decides them."""
    output: Folder | None = None
    """Folder to write to; if not given the contract's own, or the log's, and the current one for a
    robot of this package."""


def main(args: Args) -> None:
    """Measure, write, and report where the robot does not follow."""
    from hcbf_robots.identification.picture import plot  # imports Matplotlib

    identified, command, name, file = _simulated(args) if args.log is None else _driven(args)
    response = identified.response
    if args.output is not None:
        file = args.output / file.name
    elif file.resolve().is_relative_to(HERE):
        file = Path(file.name)
    response.save(file)
    picture = file.with_suffix(".png")
    plot(identified, name, picture)
    console = Console()
    console.print(_table(name, command, response))
    for complaint in response.complaints:
        console.print(f"does not follow: {complaint}")
    console.print(f"written to {file} and {picture}", soft_wrap=True)


def _simulated(args: Args) -> tuple[Identified, Command, str, Path]:
    """Return what a simulation shows, of whom, and where it is written."""
    if not args.contract:
        raise InvalidInputError("identify: got neither a contract nor --log, expected one of them")
    seconds = finite_float("seconds", args.seconds, minimum=SHORTEST, maximum=LONGEST)
    require_packages("a simulated drive; --log needs none", "mujoco")
    from hcbf_robots.identification.identify import identify
    from hcbf_robots.walkers.walker import Walker

    walker = Walker.load(args.contract)
    return (
        identify(walker, seconds, args.seed), walker.command, walker.name, walker.response_file,
    )  # fmt: skip


def _driven(args: Args) -> tuple[Identified, Command, str, Path]:
    """Return what a log shows, of whom, and where it is written."""
    assert args.log is not None
    command, name, file = None, args.log.stem, args.log.with_suffix(".response.json")
    if args.contract:
        require_packages("a contract; --log needs none", "mujoco")
        from hcbf_robots.walkers.walker import Walker

        walker = Walker.load(args.contract)
        command, name, file = walker.command, walker.name, walker.response_file
    identified, command = identify_log(args.log, command, args.look_ahead)
    return identified, command, name, file


def _table(name: str, command: Command, response: Response) -> Table:
    """Return the numbers with their units."""
    names = ("v", "ω") if command.sideways is None else ("v_x", "v_y", "ω")
    half, often, almost = response.residual
    table = Table("measured", "", title=f"{name}, {response.seconds:g} s")
    for name, gain in zip(names, response.gain, strict=True):
        table.add_row(f"gain of {name}", f"{gain:.2f}")
    table.add_row("time constant", f"{response.time_constant:.3f} s")
    table.add_row("delay", f"{response.delay:.3f} s")
    table.add_row("residual 50, 95, 99.9 %", f"{half:.3f}, {often:.3f}, {almost:.3f} m/s")
    table.add_row("deviation while it follows, 99.9 %", f"{response.deviation:.3f} m")
    table.add_row("residual that lasts, 99.9 %", f"{response.lasting:.3f} m/s")
    table.add_row("overshoot, 99.9 %", f"{response.overshoot:.3f} m/s")
    table.add_row("rise, 10 to 90 %", f"{response.rise:.2f} s")
    table.add_row("stops within", f"{response.stopping:.2f} m")
    table.add_row("brakes at", f"{response.braking:.2f} m/s²")
    table.add_row("falls", f"{response.falls}")
    return table
