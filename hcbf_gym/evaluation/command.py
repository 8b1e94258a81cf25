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
from collections.abc import Sequence
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
from hcbf_gym.evaluation.comparison import column_names, comparison
from hcbf_gym.evaluation.environments import Known
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.episode_plot import LabelledEpisodes, plot_episode, plot_paths, plot_series
from hcbf_gym.evaluation.jobs import Runs, versions
from hcbf_gym.evaluation.output_folder import check_folder, free_folder, open_folder, write_json
from hcbf_gym.evaluation.recorded import Episode
from hcbf_gym.evaluation.rollouts import SHOWN_OPTIONS, UNFILTERED, Case, aggregate, evaluate
from hcbf_gym.evaluation.sentences import sentences
from hcbf_gym.evaluation.statistics import INTERVAL
from hcbf_gym.evaluation.top_film import film
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.sources import sources_hash

RESUMED = "the same command resumes this run"  # printed after Ctrl-C
OUTPUT = Path("results/evaluate")  # the default folder
COLUMNS = 5  # pairs of policy and program beside each other in one table
OWN_MAX_STEPS = 500  # the most steps of an episode of a user's environment, by default
FILM_MAX_STEPS = 1000  # the most steps of a filmed episode of this package, by default


@dataclass(frozen=True)
class Args:
    """The evaluation; several policies and programs make a table of all their pairs."""

    env: str = "HCBF-A1Regions-v0"
    """HCBF-A1Regions-v0, HCBF-Regions-v0 (the reduced-order model alone), HCBF-WalkerRegions-v0 (a
    robot that takes velocities), or FILE.py:FUNCTION, which returns (environment, plant)."""
    robot: str = "cart"
    """Robot of HCBF-WalkerRegions-v0: a contract's path or a name."""
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
        """The facts about the environment; a user's own has none."""
        return environments.known().get(self.env, Known(None))

    @property
    def env_options(self) -> dict[str, Any]:
        """The environment's own arguments, besides the scene."""
        return {name: getattr(self, name) for name in self.known.options}


def main(args: Args) -> None:
    """Check all arguments, run every pair of policy and program, and write the results."""
    _check(args)
    scene = scenarios.on_map(args.map, args.masks, args.slow, args.scenario)
    if not args.own:
        scenarios.make(scene)
    pairs = dict.fromkeys(itertools.product(args.policy, args.program))  # each of them once
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
    """Run every case, write the summary, figures and films, and print the tables."""
    files, seeds = _files(args), range(args.seed, args.seed + args.episodes)
    settings = _settings(args, files)
    output = args.output or OUTPUT
    if args.output is None and not args.overwrite:
        output = free_folder(OUTPUT, settings)
    open_folder(output, settings, args.overwrite)
    jobs_folder = output / "episodes"  # deleted at the end; an interrupted run resumes from it
    runs = Runs(jobs_folder, args.workers, args.backend)
    summary_of: dict[tuple[str, str, int], dict[str, Any]] = {}
    first_of: dict[tuple[str, str], Episode] = {}
    for case, seed, episode in evaluate(cases, seeds, runs, "episodes", files):
        summary = case.label() | {"seed": seed} | episode.summary()
        summary_of[case.policy, case.program, seed] = summary
        if seed == args.seed:
            first_of[case.policy, case.program] = episode
    # episodes come as they finish; the results have the order of the cases
    pairs = [(case.policy, case.program) for case in cases]
    summaries = [summary_of[*pair, seed] for pair in pairs for seed in seeds]
    first_episodes = {pair: first_of[pair] for pair in pairs}
    example = first_episodes[pairs[0]]
    conditions = list(map(Condition, example.names, example.priority.tolist()))
    rows = aggregate(summaries)
    write_json(output / "summary.json", {
        "environment": args.env,
        "robot": args.env_options.get("robot", args.known.robot),
        "settings": settings,
        "seeds": [args.seed, args.seed + args.episodes - 1],
        "interval": INTERVAL,
        "barriers": [{"name": name, "priority": rank} for name, rank in conditions],
        "episodes": summaries,
        "aggregate": rows,
    })  # fmt: skip
    written = ["summary.json", *_draw(args, output, cases[0], first_episodes)]
    shutil.rmtree(jobs_folder)
    console, columns = Console(), column_names(rows)
    _print_tables(rows, conditions, columns)
    for case in cases:
        if args.video:
            written.append(_film(case, args, output))
        if args.snapshot is not None:
            _take_snapshot(case, args, args.snapshot, output)
    for row, column in zip(rows, columns, strict=True):
        pair = column.replace("\n", ", ")
        text = f"{pair}: {' '.join(sentences(row, conditions))}"
        console.print(text, soft_wrap=True, highlight=False)
    console.print(f"written to {output}: {', '.join([records.SETTINGS, *written])}", soft_wrap=True)


def _print_tables(
    rows: list[dict[str, Any]], conditions: Sequence[Condition], columns: Sequence[str]
) -> None:
    """Print the pairs as columns of tables, of which none separates the programs of a policy."""
    n_programs = len({row["program"] for row in rows})
    width = COLUMNS // n_programs * n_programs or COLUMNS
    for start in range(0, len(rows), width):
        part = slice(start, start + width)
        Console().print(comparison(rows[part], conditions, columns[part]).rich())


def _check(args: Args) -> None:
    """Refuse arguments that contradict each other, or that the environment does not take."""
    Runs(None, args.workers, args.backend).check()
    known = environments.known()
    if not (args.own or args.env in known):
        raise UnknownNameError(
            f"unknown environment: got {args.env!r}, expected one of {list(known)}, "
            "file.py:function or module:function"
        )
    for name in ("robot", "body", "intentions"):
        accepting = [env for env, facts in known.items() if name in facts.options]
        if _is_given(args, name) and args.env not in accepting:
            raise InvalidInputError(
                f"--{name}: got {getattr(args, name)!r} with {args.env}, "
                f"expected --env {' or '.join(accepting)}"
            )
    if _is_given(args, "map") and _is_given(args, "scenario"):
        raise InvalidInputError(
            f"--scenario: got {args.scenario!r} with --map {args.map}, expected one of them"
        )
    given = [n for n in ("map", "scenario", "v_max", "snapshot") if _is_given(args, n)]
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


def _is_given(args: Args, name: str) -> bool:
    """Return whether an argument differs from its default."""
    return getattr(args, name) != getattr(Args, name)


def _settings(args: Args, files: Sequence[Path]) -> dict[str, object]:
    """Return all that decides the results: arguments, hashes of the user's files, versions."""
    left_out = {"workers", "backend", "output", "overwrite", "figures", "video", "snapshot"}
    if "robot" not in args.known.options:
        left_out.add("robot")  # this environment has one robot
    deciding = {name: value for name, value in asdict(args).items() if name not in left_out}
    files_hash = sources_hash(list(files)) if files else ""
    return records.plain(deciding) | {"files": files_hash, "versions": versions()}


def _files(args: Args) -> list[Path]:
    """Return the user's own files that decide the episodes."""
    arguments = (args.scenario, args.map or "", *args.masks, *args.slow)
    files = [file for file in map(Path, arguments) if file.is_file()]
    family = scenarios.family_of(args.scenario)
    files += [] if family is None else family.files
    files += [file for name in args.policy for file in policies.files(name)]
    if args.own:
        files += loading.files(args.env)
    files += args.known.files(args.env_options)
    return sorted({file.resolve() for file in files})


def _case(args: Args, scene: Any, policy: str, program: str) -> Case:
    """Return the case of one policy and one program, with the options that the program accepts."""
    options: dict[str, object] | None = None
    if program != UNFILTERED:
        accepted = programs.options(program)
        weights = {"gamma0": args.gamma0, "delta_gamma": args.delta_gamma}
        given = {name: weight for name, weight in weights.items() if weight is not None}
        defaults = SHOWN_OPTIONS.get(program, {})
        options = {k: v for k, v in (defaults | given).items() if k in accepted}
        options["guidance"] = args.guidance
    if args.own:
        steps = OWN_MAX_STEPS if args.steps is None else args.steps
        return Case(args.env, scene, policy, program, options, steps=steps)
    env_options = args.env_options
    v_max = None if "v_max" in env_options else args.v_max
    return Case(args.env, scene, policy, program, options, env_options, v_max, args.steps)


def _draw(args: Args, output: Path, case: Case, first_episodes: LabelledEpisodes) -> list[str]:
    """Draw the first episode of each pair, and return the names of the figures' files."""
    if args.own:
        barriers = own_environment.barriers_of(args.env, args.seed)
        names = []
        for (policy, program), episode in first_episodes.items():
            name = f"episode-{_file_name(policy, args.policy)}-{program}.{args.figures}"
            plot_episode(episode, barriers, f"{policy}, {program}").savefig(output / name)
            names.append(name)
        return names
    env = case.make(seed=args.seed)
    inner: Any = env.unwrapped
    env.reset(seed=args.seed)  # which draws a random scene
    paths, series = f"paths.{args.figures}", f"series.{args.figures}"
    plot_paths(inner.scenario, first_episodes).savefig(output / paths)
    plot_series(first_episodes).savefig(output / series)
    env.close()
    return [paths, series]


def _film(case: Case, args: Args, output: Path) -> str:
    """Film the first episode of a case, and return the name of the film or of its folder."""
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
    episode = samples(env, policies.make(case.policy, env), args.seed)
    count = 1 + (FILM_MAX_STEPS if case.steps is None else case.steps)  # the reset is a sample, too
    for _ in track(itertools.islice(episode, count), f"filming {name}", total=count):
        pass  # the wrapper records each step
    env.close()
    return f"video/{name}"


def _take_snapshot(case: Case, args: Args, time: float, output: Path) -> None:
    """Save a frame of the first episode of a case at a time [s]."""
    env = case.make(render_mode="rgb_array", seed=args.seed)
    episode = samples(env, policies.make(case.policy, env), args.seed)
    for _ in itertools.islice(episode, 1 + round(time / CONTROL_DT)):
        pass
    path = output / f"snapshot-{_file_name(case.policy, args.policy)}-{case.program}.png"
    imsave(path, np.asarray(env.render()))
    env.close()


def _file_name(policy: str, policies_of_run: Sequence[str]) -> str:
    """Return a policy's name for the names of its files, without folders and endings.

    Policies of the same such name, as of a.py:act in two folders, are numbered from the second on.
    """
    stem = _stem(policy)
    namesakes = [other for other in dict.fromkeys(policies_of_run) if _stem(other) == stem]
    number = 1 + namesakes.index(policy)
    return stem if number == 1 else f"{stem}-{number}"


def _stem(policy: str) -> str:
    """Return a policy's name without folder and ending: "a-act" for x/a.py:act."""
    module, _, function = policy.rpartition(":")
    if module:
        return f"{Path(module).stem if module.endswith('.py') else module}-{function}"
    return Path(policy).stem if policies.is_own(policy) else policy
