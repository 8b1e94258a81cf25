"""Measures how a robot follows the velocities that it is commanded; margins follow from it.

A contract's robot is driven in its simulation: stops from full speed first, then random commands
that change as hard as it brakes. With --log the drive of a real robot is read from a CSV file. Its
columns are time [s], cmd_vx, cmd_vy, cmd_w (a differential drive has no cmd_vy), and the pose x, y,
yaw or the twist vx, vy, w in the robot's own axes, or both [m, m/s, rad, rad/s]. The command writes
NAME.response.json, which contracts and `hcbf_robots.Response.load` read, and a picture.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

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

SHORTEST_DRIVE, LONGEST_DRIVE = 10.0, 3600.0
"""Length of the random commands [s]: a shorter drive shows too little, a longer one no more."""
PACKAGE_FOLDER = Path(hcbf_robots.__file__).resolve().parent
"""Nothing is written here, because certificates are of the robots as they are shipped."""


@dataclass(frozen=True)
class Args:
    """The robot, and how long it is driven."""

    contract: tyro.conf.Positional[str] = ""
    """The contract's path, or the name of a walker of the package; --log needs none."""
    log: Path | None = None
    """CSV file of a drive, in place of a simulation."""
    look_ahead: Positive | None = None
    """ℓ of a differential drive without a contract: how far before its axle the point lies that
    follows [m]."""
    seconds: Annotated[float, Range(SHORTEST_DRIVE, LONGEST_DRIVE)] = 60.0
    """Length of the drive under random commands [s]."""
    seed: Seed = 0
    """Seed of the random commands."""
    output: Folder | None = None
    """Folder to write to; without it the contract's or the log's own, and the current folder for a
    robot of this package."""


class _Measured(NamedTuple):
    """A robot's response, limits and name, and the usual file of its response."""

    identified: Identified
    command: Command
    name: str
    file: Path


def main(args: Args) -> None:
    """Measure a robot, write its response and a picture, and print where it does not follow."""
    from hcbf_robots.identification.picture import plot  # imports Matplotlib

    measured = _from_simulation(args) if args.log is None else _from_log(args, args.log)
    response, file = measured.identified.response, measured.file
    if args.output is not None:
        file = args.output / file.name
    elif file.resolve().is_relative_to(PACKAGE_FOLDER):
        file = Path(file.name)
    response.save(file)
    picture = file.with_suffix(".png")
    plot(measured.identified, measured.name, picture)
    console = Console()
    console.print(_table(measured.name, measured.command, response))
    for complaint in response.complaints:
        console.print(f"does not follow: {complaint}")
    console.print(f"written to {file} and {picture}", soft_wrap=True)


def _from_simulation(args: Args) -> _Measured:
    """Drive the contract's robot in its simulation."""
    if not args.contract:
        raise InvalidInputError("identify: got neither a contract nor --log, expected one of them")
    seconds = finite_float("seconds", args.seconds, minimum=SHORTEST_DRIVE, maximum=LONGEST_DRIVE)
    require_packages("a simulated drive; --log needs none", "mujoco")
    from hcbf_robots.identification.identify import identify
    from hcbf_robots.walkers.walker import Walker

    walker = Walker.load(args.contract)
    identified = identify(walker, seconds, args.seed)
    return _Measured(identified, walker.command, walker.name, walker.response_file)


def _from_log(args: Args, log: Path) -> _Measured:
    """Read a drive's log; a contract, if there is one, has the limits of the commands."""
    command, name, file = None, log.stem, log.with_suffix(".response.json")
    if args.contract:
        require_packages("a contract; --log needs none", "mujoco")
        from hcbf_robots.walkers.walker import Walker

        walker = Walker.load(args.contract)
        command, name, file = walker.command, walker.name, walker.response_file
    identified, command = identify_log(log, command, args.look_ahead)
    return _Measured(identified, command, name, file)


def _table(title: str, command: Command, response: Response) -> Table:
    """Return the response's numbers with their units."""
    entries = ("v", "ω") if command.sideways is None else ("v_x", "v_y", "ω")
    half, often, nearly_always = response.residual
    table = Table("measured", "", title=f"{title}, {response.seconds:g} s")
    for entry, gain in zip(entries, response.gain, strict=True):
        table.add_row(f"gain of {entry}", f"{gain:.2f}")
    table.add_row("time constant", f"{response.time_constant:.3f} s")
    table.add_row("delay", f"{response.delay:.3f} s")
    table.add_row("residual 50, 95, 99.9 %", f"{half:.3f}, {often:.3f}, {nearly_always:.3f} m/s")
    table.add_row("deviation while it follows, 99.9 %", f"{response.deviation:.3f} m")
    table.add_row("residual that lasts, 99.9 %", f"{response.lasting:.3f} m/s")
    table.add_row("overshoot, 99.9 %", f"{response.overshoot:.3f} m/s")
    table.add_row("rise, 10 to 90 %", f"{response.rise:.2f} s")
    table.add_row("stops within", f"{response.stopping:.2f} m")
    table.add_row("brakes at", f"{response.braking:.2f} m/s²")
    table.add_row("falls", f"{response.falls}")
    return table
