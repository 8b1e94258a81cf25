"""Evaluate policies under safety filters: a table, figures, summary.json and, if asked, videos.

Without arguments it walks the A1 for 20 s through a scene in which ranks conflict, with no filter
and with lex-CBF-QP; sentences at the end say what became of each rank.

A policy of your own is a function (observation, info) → action as FILE.py:FUNCTION or
MODULE:FUNCTION, a zip of Stable-Baselines3, an ONNX network, or a torch module (.pt). Zips and .pt
files hold pickles, which run code when they are read: take them from those whom you trust.

The same command resumes an interrupted run.
"""

import itertools
import shutil
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from matplotlib.image import imsave
from rich.console import Console
from rich.progress import track

from hcbf_gym import loading, policies, programs, records, scenarios
from hcbf_gym.arguments import Amount, Count, Folder, Positive, Seed, Workers
from hcbf_gym.barriers.set import Condition
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    UnknownNameError,
    require,
    warned_once,
)
from hcbf_gym.evaluation import environments, own_environment
from hcbf_gym.evaluation.environments import Known
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.episode_plot import plot_episode, plot_paths, plot_series
from hcbf_gym.evaluation.jobs import Runs, versions
from hcbf_gym.evaluation.output_folder import check_folder, free_folder, open_folder, write_json
from hcbf_gym.evaluation.recorded import Episode
from hcbf_gym.evaluation.rollouts import (
    SHOWN_OPTIONS,
    UNFILTERED,
    Case,
    aggregate,
    evaluate,
    shown_program,
)
from hcbf_gym.evaluation.sentences import sentences, unit_of
from hcbf_gym.evaluation.statistics import BOUNDED, INTERVAL, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.evaluation.top_film import film
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.sources import sources_hash

RESUMED = "the same command resumes this run"  # printed after Ctrl-C
OUTPUT = Path("results/evaluate")
FEW = 10  # with fewer episodes a bound on entering would be near 1, and the table has none
COLUMNS = 5  # pairs of policy and program beside each other in one table
OWN_STEPS = 500  # the most steps of an episode of a user's environment, by default


@dataclass(frozen=True)
class Args:
    """What to evaluate; several policies and programs make a table of all their pairs."""

    env: str = "HCBF-A1Regions-v0"
    """HCBF-A1Regions-v0, HCBF-Regions-v0 (the reduced-order model alone), HCBF-WalkerRegions-v0 (a
    robot that takes velocities), or FILE.py:FUNCTION, which returns (environment, plant)."""
    robot: str = "cart"
    """Of HCBF-WalkerRegions-v0: a contract's path or a name."""
    scenario: str = "trolley"
    """A name from hcbf_gym.scenarios.names(), a JSON file's path, or FILE.py:FAMILY of your own."""
    map: Path | None = None
    """A map of Nav2 instead of a scene: YAML beside a PGM or PNG. Seeds draw start and goal."""
    masks: dict[str, Count] = field(default_factory=dict)
    """Masks over that map and their ranks: --masks keepout.yaml 2 avoid.yaml 3."""
    slow: dict[str, Positive] = field(default_factory=dict)
    """Masks of zones and the speed limit there [m/s], as rank 2: --slow school.yaml 0.4."""
    v_max: Positive | None = None
    """Cap on the speed [m/s; default: the scene's]."""
    body: Literal["point", "footprint"] = "point"
    """What must stay outside: the robot's centre, or the whole robot."""
    intentions: Literal["known", "hidden"] = "known"
    """Whether regions of random-crossing keep their speeds; of HCBF-Regions-v0."""
    policy: tuple[str, ...] = ("pd",)
    """pd, pd-ff (the reference's acceleration fed forward), a name of hcbf train's, or policies of
    your own: file.py:function, module:function, model.zip, policy.onnx, policy.pt, policy.npz."""
    program: tuple[str, ...] = (UNFILTERED, "lex-cbf-qp")
    """none, which is no filter, or names from hcbf_gym.programs.names()."""
    guidance: Literal["geodesic", "local"] | None = None
    """Lead around the regions: to the goal, or where none is known."""
    gamma0: Amount | None = None
    """Weight γ₀ of all programs that take one [default: r 0.05, h 5.0]."""
    delta_gamma: Amount | None = None
    """Slope Δγ of their weights [default: h 1.3]."""
    episodes: Count = 1
    """Episodes of each pair, with the seeds seed, seed + 1, …"""
    seed: Seed = 0
    """First seed."""
    steps: Count | None = None
    """The most that an episode takes [default: what the environment does; 500 of your own]."""
    workers: Workers | None = None
    """Episodes that run at once [default: as many as the backend has CPUs]."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""
    output: Folder | None = None
    """Folder for the table, the figures and summary.json [default: results/evaluate, or
    results/evaluate-2, … where that holds another run]."""
    overwrite: bool = False
    """Write over what another run left in that folder."""
    figures: Literal["png", "pdf", "svg"] = "png"
    """What the figures are saved as."""
    video: bool = False
    """Record the first episode of each pair; needs the extra `video` and, of an environment of this
    package, OpenGL. One of your own is seen from above."""
    snapshot: Amount | None = None
    """Save a frame of the first episode of each pair at this time [s]; needs OpenGL."""

    @property
    def own(self) -> bool:
        """Whether the environment is the user's own."""
        return loading.is_function(self.env)

    @property
    def known(self) -> Known:
        """What is known of the environment; nothing of a user's own."""
        return environments.known().get(self.env, Known(None))

    @property
    def env_options(self) -> dict[str, Any]:
        """Further arguments of the environment."""
        return {name: getattr(self, name) for name in self.known.options}


def main(args: Args) -> None:
    """Check all arguments, run every pair of policy and program, and write the results."""
    _check(args)
    scene = scenarios.on_map(args.map, args.masks, args.slow, args.scenario)
    if not args.own:
        scenarios.make(scene)
    pairs = dict.fromkeys(itertools.product(args.policy, args.program))  # one named twice is one
    cases = [_case(args, scene, *pair) for pair in pairs]
    if args.output is not None:
        check_folder(args.output, _settings(args, _files(args)), args.overwrite)
    with warned_once():  # bad names, options and policies fail before work begins
        for case in cases:
            env = case.make(seed=args.seed)
            policies.try_out(case.policy, env, args.seed)
            env.close()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)  # `try_out` has given it
        _run(args, cases)


def _run(args: Args, cases: Sequence[Case]) -> None:
    """Run every case, and write the summary, figures, films and tables."""
    files, seeds = _files(args), range(args.seed, args.seed + args.episodes)
    settings = _settings(args, files)
    output = args.output or OUTPUT
    if args.output is None and not args.overwrite:
        output = free_folder(OUTPUT, settings)
    open_folder(output, settings, args.overwrite)
    finished = output / "episodes"
    runs = Runs(finished, args.workers, args.backend)
    episodes = evaluate(cases, seeds, runs, "episodes", files)
    summaries: dict[tuple[str, str, int], dict[str, Any]] = {}
    shown: dict[tuple[str, str], Episode] = {}
    for case, seed, episode in episodes:
        label = case.label() | {"seed": seed}
        summaries[case.policy, case.program, seed] = label | episode.summary()
        if seed == args.seed:
            shown[case.policy, case.program] = episode
    pairs = [(case.policy, case.program) for case in cases]
    listed = [summaries[*pair, seed] for pair in pairs for seed in seeds]
    rows = aggregate(listed)
    first_episodes = {pair: shown[pair] for pair in pairs}
    example = first_episodes[pairs[0]]
    ranks = example.priority.tolist()
    conditions = [Condition(*one) for one in zip(example.names, ranks, strict=True)]
    write_json(output / "summary.json", {
        "environment": args.env,
        "robot": args.env_options.get("robot", args.known.robot),
        "settings": settings,
        "seeds": [args.seed, args.seed + args.episodes - 1],
        "interval": INTERVAL,
        "barriers": [{"name": one.name, "priority": one.rank} for one in conditions],
        "episodes": listed,
        "aggregate": rows,
    })  # fmt: skip
    written = _draw(args, output, cases[0], first_episodes)
    shutil.rmtree(finished)
    console, labels = Console(), column_names(rows)
    _print_tables(console, rows, conditions, labels, len(set(args.program)))
    for case in cases:
        if args.video:
            written.append(_record(case, args, output))
        if args.snapshot is not None:
            _take_snapshot(case, args, args.snapshot, output)
    for row, label in zip(rows, labels, strict=True):
        text = f"{label.replace(chr(10), ', ')}: {' '.join(sentences(row, conditions))}"
        console.print(text, soft_wrap=True, highlight=False)
    console.print(f"written to {output}: {', '.join([records.SETTINGS, *written])}", soft_wrap=True)


def _print_tables(
    console: Console,
    rows: list[dict[str, Any]],
    conditions: Sequence[Condition],
    labels: Sequence[str],
    programs_of_policy: int,
) -> None:
    """Print the rows in tables of `COLUMNS`, in which the programs of a policy stay together."""
    columns = COLUMNS // programs_of_policy * programs_of_policy or COLUMNS
    for start in range(0, len(rows), columns):
        part = slice(start, start + columns)
        console.print(comparison(rows[part], conditions, labels[part]).rich())


def _check(args: Args) -> None:
    """Refuse arguments that do not fit each other."""
    Runs(None, args.workers, args.backend).check()
    if not (args.own or args.env in environments.known()):
        raise UnknownNameError(
            f"unknown environment: got {args.env!r}, expected one of {list(environments.known())}, "
            "file.py:function or module:function"
        )
    for name in ("robot", "body", "intentions"):
        takes = [env for env, one in environments.known().items() if name in one.options]
        value = getattr(args, name)
        if value != getattr(Args, name) and args.env not in takes:
            raise InvalidInputError(
                f"--{name}: got {value!r} with {args.env}, expected --env {' or '.join(takes)}"
            )
    given = [
        name
        for name in ("map", "scenario", "v_max", "snapshot")
        if getattr(args, name) != getattr(Args, name)
    ]
    if {"map", "scenario"} <= {*given}:
        raise InvalidInputError(
            f"--scenario: got {args.scenario!r} with --map {args.map}, expected one of them"
        )
    if args.own and given:
        raise InvalidInputError(
            f"evaluate: got {', '.join(given)} with {args.env}, whose plant decides all that"
        )
    for policy in args.policy:
        policies.check(policy)
        if args.own and not policies.is_own(policy):
            raise InvalidInputError(
                f"policy: got {policy!r} with {args.env}, whose observations it does not know; "
                f"expected one of your own: {policies.FORMS}"
            )
    if args.video:
        require("--video", "video", "moviepy")


def _settings(args: Args, files: Sequence[Path]) -> dict[str, object]:
    """Return all that decides a run: arguments, hashes of the user's files, and versions."""
    left_out = {"workers", "backend", "output", "overwrite", "figures", "video", "snapshot"}
    if "robot" not in args.known.options:
        left_out.add("robot")  # this environment has one robot
    given = {name: value for name, value in asdict(args).items() if name not in left_out}
    decided = {"files": sources_hash(list(files)) if files else "", "versions": versions()}
    return records.plain(given) | decided


def _files(args: Args) -> list[Path]:
    """Return the user's own files that decide the episodes."""
    given = (args.scenario, args.map or "", *args.masks, *args.slow)
    files = [file for file in map(Path, given) if file.is_file()]
    family = scenarios.family_of(args.scenario)
    files += [] if family is None else family.files
    files += [file for name in args.policy for file in policies.files(name)]
    if args.own:
        files += loading.files(args.env)
    files += args.known.files(args.env_options)
    return sorted({file.resolve() for file in files})


def _case(args: Args, scene: Any, policy: str, program: str) -> Case:
    """Return the case of one policy and one program, with the options that the program takes."""
    options: dict[str, object] | None = None
    if program != UNFILTERED:
        accepted = programs.options(program)
        options = {k: v for k, v in SHOWN_OPTIONS.get(program, {}).items() if k in accepted}
        given = {"gamma0": args.gamma0, "delta_gamma": args.delta_gamma}
        options |= {k: v for k, v in given.items() if v is not None and k in accepted}
        options["guidance"] = args.guidance
    if args.own:
        steps = OWN_STEPS if args.steps is None else args.steps
        return Case(args.env, scene, policy, program, options, steps=steps)
    env_options = args.env_options
    v_max = None if "v_max" in env_options else args.v_max
    return Case(args.env, scene, policy, program, options, env_options, v_max, args.steps)


def _draw(
    args: Args, output: Path, case: Case, shown: Mapping[tuple[str, str], Episode]
) -> list[str]:
    """Draw the first episodes; return the names of the files written: summary.json, figures."""
    written = ["summary.json"]
    if args.own:
        barriers = own_environment.barriers_of(args.env, args.seed)
        for (policy, program), episode in shown.items():
            name = f"episode-{_file_name(policy, args.policy)}-{program}.{args.figures}"
            plot_episode(episode, barriers, f"{policy}, {program}").savefig(output / name)
            written.append(name)
        return written
    env = case.make(seed=args.seed)
    inner: Any = env.unwrapped
    env.reset(seed=args.seed)
    paths, series = f"paths.{args.figures}", f"series.{args.figures}"
    plot_paths(inner.scenario, shown).savefig(output / paths)
    plot_series(shown).savefig(output / series)
    env.close()
    return [*written, paths, series]


def column_names(rows: list[dict[str, Any]]) -> list[str]:
    """Return the titles of columns: policy and program, or the program if there is one policy."""
    programs = [shown_program(row["program"]) for row in rows]
    if len({row["policy"] for row in rows}) == 1:
        return programs
    return [f"{row['policy']}\n{program}" for row, program in zip(rows, programs, strict=True)]


def comparison(
    rows: list[dict[str, Any]], conditions: Sequence[Condition], header: Sequence[str]
) -> Table:
    """Return a table with a column for each pair of policy and program.

    Args:
        rows: as `aggregate` returns them, all of one environment and scene.
        conditions: of the scene.
        header: the titles of the columns.
    """
    cells: list[tuple[str, ...]] = []
    for k, (name, rank) in enumerate(conditions):
        title = f"{name} (rank {rank}): min h [{unit_of(name)}]"
        cells.append((title, *(f"{row['min_h'][k]:+.3f}" for row in rows)))
        cells.append(("time below 0 [s]", *(f"{row['violation_seconds'][k]:.2f}" for row in rows)))
    track = rows[0].get("task") == "track"
    for title, key, form in (
        ("tracking error, RMS [m]", "tracking_rms", ".3f"),
        ("final error [m]", "final_error", ".3f"),
        ("‖u − u*‖, RMS [m/s²]", "intervention_rms", ".2f"),
        ("return (rewards tracking alone)" if track else "return", "return", ".2f"),
        ("episodes that fell", "fell", ".0%"),
        ("episodes that reached the goal", "reached", ".0%"),
        ("time to the goal [s]", "seconds_to_goal", ".2f"),
        ("time standing though u* wants to move", "deadlock_share", ".0%"),
    ):
        if key in rows[0]:
            cells.append((title, *(_cell(row, key, form) for row in rows)))
    n = rows[0]["episodes"]
    if n > 1:
        title = "episodes that entered a strict region"
        bounded = n >= FEW
        entered = [counted(row["entered"], n) if bounded else str(row["entered"]) for row in rows]
        cells.append((f"{title} ({BOUNDED})" if bounded else title, *entered))
    cells += [
        (
            f"steps with status {status}",
            *(
                "–" if row["program"] == UNFILTERED else str(row["status_counts"][status])
                for row in rows
            ),
        )
        for status in ("VIOLATED", "UNSAFE", "BACKUP")
    ]
    policies = ", ".join(dict.fromkeys(row["policy"] for row in rows))
    title = f"{rows[0]['env']}, {rows[0]['scenario']}, {policies}, {n} episode{'s' * (n > 1)} each"
    return Table(f"{title}; [{INTERVAL:.0%} interval]" if n > 1 else title, ("", *header), cells)


def _cell(row: Mapping[str, Any], key: str, form: str) -> str:
    """Return a figure as text, with its interval if there is one; a dash if it is not known."""
    value, interval = row[key], row.get("intervals", {}).get(key)
    if value is None:
        return "–"
    text = format(value, form)
    if interval is None or row["episodes"] == 1:
        return text
    low, high = (format(end, ".1%" if form == ".0%" else form) for end in interval)
    return f"{format(value, '.1%' if form == '.0%' else form)} [{low}, {high}]"


def _record(case: Case, args: Args, output: Path) -> str:
    """Film the first episode of a case, and return the name of the film."""
    name = f"{_file_name(case.policy, args.policy)}-{case.program}"
    folder = output / "video" / name
    if args.own:
        records.make_folder(folder.parent)
        barriers = own_environment.barriers_of(args.env, args.seed)
        film(case.run(args.seed), folder.with_suffix(".mp4"), barriers)
        return f"video/{name}.mp4"
    env = gym.wrappers.RecordVideo(
        case.make(render_mode="rgb_array", seed=args.seed),
        str(folder),
        episode_trigger=lambda _: True,
        disable_logger=True,
    )
    walk = samples(env, policies.make(case.policy, env), args.seed)
    most = 1000 if case.steps is None else case.steps
    for _ in track(itertools.islice(walk, most + 1), f"filming {name}", total=most + 1):
        pass
    env.close()
    return f"video/{name}"


def _take_snapshot(case: Case, args: Args, time: float, output: Path) -> None:
    """Save a frame of the first episode of a case at a time [s]."""
    env = case.make(render_mode="rgb_array", seed=args.seed)
    walk = samples(env, policies.make(case.policy, env), args.seed)
    deque(itertools.islice(walk, 1 + round(time / CONTROL_DT)), maxlen=0)
    path = output / f"snapshot-{_file_name(case.policy, args.policy)}-{case.program}.png"
    imsave(path, np.asarray(env.render()))
    env.close()


def _file_name(policy: str, beside: Sequence[str]) -> str:
    """Return a policy's name for the name of a file, without folders and endings.

    Of those `beside` it with the same the second is numbered 2, and so on.
    """
    same = [one for one in dict.fromkeys(beside) if _stem(one) == _stem(policy)]
    number = same.index(policy)
    return f"{_stem(policy)}-{number + 1}" if number else _stem(policy)


def _stem(policy: str) -> str:
    where, _, function = policy.rpartition(":")
    if not where:
        return Path(policy).stem if policies.is_own(policy) else policy
    return f"{Path(where).stem if where.endswith('.py') else where}-{function}"
