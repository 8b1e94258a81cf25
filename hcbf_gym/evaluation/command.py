"""Evaluate policies under safety filters: a table, figures, summary.json and, if asked, videos.

Without arguments it walks the A1 through the paper's course, 20 s each, with no filter, with
R-CBF-QP and with H-CBF-QP. One that was interrupted goes on where it stopped.
"""

import itertools
import shutil
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from matplotlib.image import imsave
from rich.console import Console

from hcbf_gym import programs, scenarios
from hcbf_gym.barriers import Barrier
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError, require
from hcbf_gym.evaluation.chunks import Runs
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.episode_plot import plot_paths, plot_series
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.evaluation.rollouts import (
    SHOWN_OPTIONS,
    UNFILTERED,
    Case,
    Episode,
    aggregate,
    evaluate,
    make_policy,
    rollout,
)
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.evaluation.workers import Backend, Workers
from hcbf_gym.robots.walker import Walker

COLUMNS = 5
"""Pairs of policy and program beside each other in one table."""


@dataclass(frozen=True)
class Args:
    """What to evaluate; several policies and programs make a table of all their pairs."""

    env: Literal["HCBF-A1Regions-v0", "HCBF-Regions-v0", "HCBF-WalkerRegions-v0"] = (
        "HCBF-A1Regions-v0"
    )
    """The A1, the reduced-order model alone, or a robot that takes velocities."""
    robot: str = "cart"
    """Of HCBF-WalkerRegions-v0: a contract's path or a name."""
    scenario: str = "paper-simulation"
    """A name from hcbf_gym.scenarios.names(), or a path to a JSON file."""
    policy: tuple[str, ...] = ("pd",)
    """pd, pd-ff (the reference's acceleration fed forward), or learned policies."""
    program: tuple[str, ...] = (UNFILTERED, "r-cbf-qp", "h-cbf-qp")
    """none, or names from hcbf_gym.programs.names()."""
    gamma0: float | None = None
    """Weight γ₀ of all programs that take one [default: r 0.05, h 5.0]."""
    delta_gamma: float | None = None
    """Slope Δγ of the weight, likewise [default: h 1.3]."""
    margin: float | None = None
    """What strict rows reserve between h and zero [m; default: the environment's]."""
    solver: str | None = None
    """daqp, clarabel, or any solver that qpsolvers finds installed [default: none is needed]."""
    feedback: Literal["measured", "position", "rom"] = "position"
    """On which state the A1 closes its loop."""
    episodes: int = 1
    """Episodes of each pair, with the seeds seed, seed + 1, …"""
    seed: int = 0
    """First seed."""
    workers: Workers = None
    """Episodes that run at once."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""
    output: Path = Path("results/evaluate")
    """Folder for the table, the figures and summary.json."""
    video: bool = False
    """Record the first episode of each pair; needs the extra `video` and OpenGL."""
    snapshot: float | None = None
    """Save a frame of the first episode of each pair at this time [s]; needs OpenGL."""


def main(args: Args) -> None:
    """Run every pair of policy and program, and write what came out."""
    if args.episodes < 1:
        raise InvalidInputError(f"episodes: got {args.episodes}, expected at least 1")
    if args.video:
        require("--video", "video", "moviepy")
    cases = [_case(args, policy, program) for policy in args.policy for program in args.program]
    for case in cases:  # bad names and options fail here, before anything runs
        env = case.make()
        make_policy(case.policy, env)
        env.close()
    seeds = range(args.seed, args.seed + args.episodes)
    finished = args.output / "episodes"
    runs = Runs(finished, args.workers, args.backend)
    episodes = evaluate(cases, seeds, runs, "episodes", _files(args))
    summaries: dict[tuple[str, str, int], dict[str, Any]] = {}
    shown: dict[tuple[str, str], Episode] = {}
    for case, seed, episode in episodes:
        label = case.label() | {"seed": seed}
        summaries[case.policy, case.program, seed] = label | episode.summary()
        if seed == args.seed:
            shown[case.policy, case.program] = episode
    pairs = [(case.policy, case.program) for case in cases]
    in_order = [summaries[*pair, seed] for pair in pairs for seed in seeds]
    rows = aggregate(in_order)
    _write(args, cases, in_order, rows, {pair: shown[pair] for pair in pairs})
    shutil.rmtree(finished)
    console, scene = Console(), scenarios.make(args.scenario)
    for start in range(0, len(rows), COLUMNS):
        console.print(comparison(rows[start : start + COLUMNS], scene.barriers).rich())
    for case in cases:
        if args.video:
            _record(case, args)
        if args.snapshot is not None:
            _take_snapshot(case, args, args.snapshot)
    console.print(f"written to {args.output}: summary.json, paths.png, series.png")


def _files(args: Args) -> list[Path]:
    """Return the files of the user's own that decide the episodes."""
    files = [file for file in map(Path, (args.scenario, *args.policy)) if file.is_file()]
    if args.env == "HCBF-WalkerRegions-v0":
        files += Walker.load(args.robot).files
    return files


def _case(args: Args, policy: str, program: str) -> Case:
    options: dict[str, Any] | None = None
    if program != UNFILTERED:
        accepted = programs.options(program)
        options = {k: v for k, v in SHOWN_OPTIONS.get(program, {}).items() if k in accepted}
        given = {"gamma0": args.gamma0, "delta_gamma": args.delta_gamma}
        options |= {k: v for k, v in given.items() if v is not None and k in accepted}
        options["solver"] = args.solver
        if args.margin is not None:
            options["margin"] = args.margin
    env_options: dict[str, Any] = {}
    if args.env == "HCBF-A1Regions-v0":
        env_options["feedback"] = args.feedback
    elif args.env == "HCBF-WalkerRegions-v0":
        env_options["robot"] = args.robot
    return Case(args.env, args.scenario, policy, program, options, env_options)


def _write(
    args: Args,
    cases: list[Case],
    summaries: list[dict[str, Any]],
    rows: list[dict[str, Any]],
    shown: dict[tuple[str, str], Episode],
) -> None:
    env = cases[0].make()
    inner: Any = env.unwrapped
    env.reset(seed=args.seed)
    barriers = inner.barriers
    settings = asdict(args) | {"output": str(args.output)}
    summary = {
        "settings": settings,
        "barriers": [{"name": b.name, "priority": b.priority} for b in barriers],
        "episodes": summaries,
        "aggregate": rows,
    }
    write_json(args.output / "summary.json", summary)
    plot_paths(inner.scenario, shown).savefig(args.output / "paths.png")
    plot_series(barriers, shown).savefig(args.output / "series.png")
    env.close()


def comparison(rows: list[dict[str, Any]], barriers: Sequence[Barrier]) -> Table:
    """Return a table with a column for each pair of policy and program.

    Args:
        rows: as `aggregate` returns them, all of one environment and scene.
        barriers: of the scene.
    """
    one_policy = len({row["policy"] for row in rows}) == 1
    header = [
        row["program"] if one_policy else f"{row['policy']}, {row['program']}" for row in rows
    ]
    cells: list[tuple[str, ...]] = []
    for k, barrier in enumerate(barriers):
        title = f"{barrier.name} (priority {barrier.priority}): min h [m]"
        cells.append((title, *(f"{row['min_h'][k]:+.3f}" for row in rows)))
        cells.append(("time below 0 [s]", *(f"{row['violation_seconds'][k]:.2f}" for row in rows)))
    for title, key, form in (
        ("tracking error, RMS [m]", "tracking_rms", ".3f"),
        ("final error [m]", "final_error", ".3f"),
        ("‖u − u*‖, RMS [m/s²]", "intervention_rms", ".2f"),
        ("episodes that fell", "fell", ".0%"),
        ("episodes that reached the goal", "reached", ".0%"),
        ("time standing though u* wants to move", "deadlock_share", ".0%"),
        ("steps in a strict region", "outside_steps", "d"),
    ):
        cells.append((title, *(format(row[key], form) for row in rows)))
    n = rows[0]["episodes"]
    if n > 1:  # one episode bounds nothing
        entered = (counted(row["entered"], n) for row in rows)
        cells.append((f"episodes that entered a strict region ({BOUNDED})", *entered))
    for status in ("VIOLATED", "UNSAFE", "BACKUP"):
        counts = (str(row["status_counts"][status]) for row in rows)
        cells.append((f"steps with status {status}", *counts))
    title = f"{rows[0]['env']}, {rows[0]['scenario']}, {rows[0]['episodes']} episode(s) each"
    return Table(title, ("", *header), cells)


def _record(case: Case, args: Args) -> None:
    env = gym.wrappers.RecordVideo(
        case.make(render_mode="rgb_array"),
        str(args.output / "video" / f"{case.policy}-{case.program}"),
        episode_trigger=lambda _: True,
        disable_logger=True,
    )
    rollout(env, make_policy(case.policy, env), args.seed)
    env.close()


def _take_snapshot(case: Case, args: Args, time: float) -> None:
    env = case.make(render_mode="rgb_array")
    walk = samples(env, make_policy(case.policy, env), args.seed)
    deque(itertools.islice(walk, 1 + round(time / CONTROL_DT)), maxlen=0)
    path = args.output / f"snapshot-{case.policy}-{case.program}.png"
    imsave(path, np.asarray(env.render()))
    env.close()
