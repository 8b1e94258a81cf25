"""A number for the promise: calibrate a plant's margins, freeze, certify on fresh episodes.

PLANT is "regions", "a1", "a1-mixture", a walker's name or contract, or a function of your own that
returns (environment, plant), as FILE.py:FUNCTION or MODULE:FUNCTION. Runs until P(enter) is below
--bound, or until that is hopeless. Writes NAME.json, which SafetyFilter takes as certificate=, and
NAME.md. Run it again to resume it.

With --check FILE, or the name of a shipped one, it repeats a random part of a certificate instead.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from hcbf_gym import certificates, policies, programs, records
from hcbf_gym.arguments import Count, Folder, Positive, Range, Seed, Workers
from hcbf_gym.certificates import Certificate
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import MAX_COUNT, HcbfError, InvalidInputError, RefusedError, choose
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.jobs import Runs, versions
from hcbf_gym.evaluation.output_folder import check_folder, open_folder, write_text
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.models.plant import Uncertainty
from hcbf_lab.certification import calibration, certify, check, families, page
from hcbf_lab.certification.check import SAFER
from hcbf_lab.certification.families import Family, OwnFamily, SceneFamily
from hcbf_lab.certification.mixture import A1Mixture
from hcbf_robots.walkers.walker import NAMES, Walker
from hcbf_robots.walkers.walker_margins import uncertainty
from hcbf_robots.walkers.walker_response import assumed

MIN_CAP_SHARE = 0.5  # a walker's lowest cap, as a share of its contract's greatest speed
MIN_CAP_RESERVES = 2.5
"""A walker's lowest cap, as a multiple of the reserve of its speed row before calibration. The
environment requires a multiple above 2."""
PLANTS: dict[str, SceneFamily | A1Mixture] = {
    "regions": SceneFamily("HCBF-Regions-v0"),
    "a1": SceneFamily("HCBF-A1Regions-v0"),
    "a1-mixture": A1Mixture(),
}
"""The families of episodes of the package's own plants except walkers, by name."""
RESUMED = "the same command resumes this run"  # printed after Ctrl-C

Share = Annotated[float, Range(0.0, 1.0 - 1e-12, above=True)]
EpisodeNumber = Annotated[int, Range(0, MAX_COUNT)]


@dataclass(frozen=True)
class Args:
    """Which plant to certify, by how many episodes of which kind."""

    plant: Annotated[str | None, tyro.conf.Positional] = None
    """The plant to certify."""
    bound: Share = 0.01
    """The bound on P(enter). If none enters, 859 episodes show 1 %, 8,630 show 1 ‰; each episode
    that enters requires a quarter more."""
    at_most: Count | None = None
    """Episodes to wait for; ten times those fewest if not given. More may be requested later."""
    confidence: Share = 0.999
    """The confidence of the bound."""
    attempt: Annotated[int, Range(0, 50), tyro.conf.arg(name="try")] = 0
    """The number of this try, from 1, if a plant may be tried again. Each try has fresh episodes,
    and the n-th spends 2⁻ⁿ of the doubt. 0 is the only try ever, and spends all of the doubt."""
    part: tuple[EpisodeNumber, EpisodeNumber] | None = None
    """First episode, from 0, and the one after the last, that this machine runs. Put the episodes
    of all machines into one folder, and run the command without --part."""
    episodes: Count = 50
    """Episodes that --check repeats; if it repeats all, it repeats the calibration, too."""
    calibration: Annotated[int, Range(0, MAX_COUNT)] = 200
    """Episodes of each round that sets the margins; 0 takes the plant's own margins."""
    scenes: tuple[str, ...] = ()
    """Families of random scenes, FILE.py:FAMILY of your own too; all covered ones if not given."""
    policies: tuple[str, ...] = ()
    """Attacks and policies, each as likely; all that can act in these scenes if not given. Your own
    too: file.py:function, module:function, model.zip, policy.onnx, policy.pt; a zip and a .pt hold
    pickles, which run code."""
    v_max: tuple[Positive, Positive] | None = None
    """Least and greatest cap on the speed of a walker [m/s]; if not given, half of its greatest
    speed, or as much as its speed row needs, to all of it."""
    steps: Count | None = None
    """The most steps of an episode; 1,000, or 500 of a plant of your own, if not given."""
    program: str = "lex-cbf-qp"
    """The program of the filter."""
    strict: Literal["rows", "gatekeeper"] = "rows"
    """How the filter satisfies strict conditions: by rows, or by verified manoeuvres."""
    seed: Seed = 0
    """Decides the episodes; calibration and certificate never share one."""
    name: str | None = None
    """The certificate's name; the plant's name if not given."""
    check: str | None = None
    """A certificate's file, or the name of a shipped one, of which a random part is repeated."""
    workers: Workers | None = None
    """Episodes that run at once [default: as many as the backend has CPUs]."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""
    output: Folder | None = None
    """Folder of the episodes and of the certificate; results/certify/NAME if not given."""


def main(args: Args) -> None:
    """Certify a plant, or check a certificate, and print the result."""
    runs = Runs(None, args.workers, args.backend)
    runs.check()
    console = Console()
    if args.check is not None:
        _check(args.check, args, runs, console)
    elif args.plant is not None:
        _certify(args.plant, args, runs, console)
    else:
        raise InvalidInputError("certify: got no plant, expected one, or --check FILE")


def _certify(plant: str, args: Args, runs: Runs, console: Console) -> None:
    """Validate the arguments, calibrate, and run the episodes of a certificate or a part."""
    if args.part is not None and not args.part[0] < args.part[1]:
        first, end = args.part
        raise InvalidInputError(f"part: got {first} to {end}, expected 0 <= first < end")
    choose("program", args.program, dict.fromkeys(programs.names()))
    name = records.check_name("name", _name(plant) if args.name is None else args.name)
    family = family_of(args)
    folder = args.output or Path("results/certify") / name
    settings = records.plain({
        "plant": plant, "family": families.to_dict(family), "bound": args.bound,
        "confidence": args.confidence, "try": args.attempt, "seed": args.seed,
        "calibration": args.calibration, "versions": versions(),
    })  # fmt: skip
    check_folder(folder, settings)
    _try_out(family, args.seed)
    open_folder(folder, settings)
    runs = replace(runs, folder=folder / "episodes")
    frozen = certify.Frozen(
        name, family, margins=None, calibration=(), bound=args.bound,
        confidence=args.confidence, attempt=args.attempt, seed=args.seed,
    )  # fmt: skip
    console.print(f"{name}: {frozen.fewest:,} episodes, if none enters, for P ≤ {args.bound:.3g}")
    margins, rounds = _margins(args, family, runs, console)
    frozen = replace(frozen, margins=margins, calibration=rounds)
    if args.part is not None:
        seen = list(certify.episodes(frozen, runs, range(*args.part)))
        entered = sum(episode.entered for episode in seen)
        console.print(f"{entered} of {len(seen)} entered; kept in {runs.folder}", soft_wrap=True)
        return
    certificate = certify.certify(frozen, runs, args.at_most)
    file = folder / f"{name}.json"
    certificate.save(file)
    write_text(file.with_suffix(".md"), page.page(certificate))
    console.print(certificate.summary, soft_wrap=True)
    console.print(f"written to {file} and {file.with_suffix('.md')}", soft_wrap=True)


def family_of(args: Args) -> Family:
    """Return the family of episodes that the arguments name.

    Raises:
        HcbfError: if there is no such plant, scene or policy.
    """
    assert args.plant is not None
    requested: dict[str, Any] = {"program": args.program}
    if args.strict != "rows":
        requested["strict"] = args.strict
    if args.policies:
        requested["policies"] = tuple((policy, 1.0) for policy in args.policies)
    if args.steps is not None:
        requested["steps"] = args.steps
    if ":" in args.plant:
        if args.scenes or args.v_max is not None:
            raise InvalidInputError(
                f"certify: got scenes or v_max with {args.plant}, whose environment draws its own"
            )
        return OwnFamily(args.plant, **requested)
    if args.scenes:
        requested["scenes"] = tuple((scene, 1.0) for scene in args.scenes)
    if args.plant in PLANTS:
        if args.v_max is not None:
            raise InvalidInputError(f"certify: got v_max with {args.plant}, expected a walker")
        has_choices = args.scenes or args.policies or "strict" in requested
        if args.plant == "a1-mixture" and has_choices:
            raise InvalidInputError(
                "certify: got scenes, policies or strict with a1-mixture, which has its own"
            )
        return _with_able_policies(args, replace(PLANTS[args.plant], **requested))
    if args.plant not in NAMES and not args.plant.endswith(".json"):
        raise InvalidInputError(
            f"certify: got the plant {args.plant!r}, expected one of {sorted([*PLANTS, *NAMES])}, "
            "a contract's path, module:function or file.py:function"
        )
    caps = caps_of(Walker.load(args.plant)) if args.v_max is None else args.v_max
    family = SceneFamily("HCBF-WalkerRegions-v0", {"robot": args.plant}, caps=caps, **requested)
    return _with_able_policies(args, family)


def _with_able_policies(args: Args, family: SceneFamily | A1Mixture) -> Family:
    """Return a family without default policies that cannot act in the requested scenes."""
    if not args.scenes or args.policies or isinstance(family, A1Mixture):
        return family
    able = families.policies_in(family.env, family.options, args.scenes)
    return replace(family, policies=able)


def _try_out(family: Family, seed: int) -> None:
    """Refuse a user's policy or environment that fails in the first two steps of an episode."""
    if not isinstance(family, SceneFamily | OwnFamily):
        return
    names = [name for name, _ in family.policies]
    for name in names:
        unguided = name.removesuffix(families.GUIDED)
        if not attacks.is_attack(unguided):
            policies.check(unguided)
    to_try = [name for name in names if policies.is_own(name)]
    if isinstance(family, OwnFamily) and not to_try:
        to_try = names[:1]  # any policy shows whether the user's environment runs
    for name in to_try:
        if policies.is_own(name) and not attacks.is_attack(name):
            env, _ = certify.make(family)
            policies.try_out(name, env, seed)
            env.close()
        two_steps = replace(family, policies=((name, 1.0),), steps=2)
        try:
            families.run_seed(two_steps, None, seed)
        except HcbfError:
            raise
        except Exception as error:  # a user's environment or attack may raise any
            reason = str(error).strip().partition("\n")[0]
            raise InvalidInputError(
                f"certify: got {type(error).__name__}: {reason} in the first steps of an episode "
                f"with the policy {name!r}, expected none"
            ) from error


def caps_of(walker: Walker) -> tuple[float, float]:
    """Return the least and the greatest cap on the speed of a walker [m/s]."""
    greatest = walker.command.forward
    response = walker.response or assumed(walker.command)
    reserve = uncertainty(response, CONTROL_DT).speed
    least = max(MIN_CAP_SHARE * greatest, MIN_CAP_RESERVES * reserve)
    return min(least, greatest), greatest


def _margins(
    args: Args, family: Family, runs: Runs, console: Console
) -> tuple[Uncertainty | None, tuple[Mapping[str, Any], ...]]:
    """Return margins and the rounds of their calibration, both as `certify.Frozen` takes them.

    The A1's mixture draws another plant for each episode, whose own law gives the margins.
    """
    if isinstance(family, A1Mixture):
        return None, ()
    plant, _ = certify.plant_of(family)
    if args.calibration == 0:
        return plant.uncertainty, ()
    calibrated = certify.calibrated(
        family, plant.uncertainty, runs, args.calibration, args.bound / SAFER, args.seed
    )
    for done in calibrated.rounds:
        console.print(
            f"{done.what}: {done.entered} of {done.episodes} entered, least h {done.least_h:+.4g}, "
            f"with distance {done.margins['distance']:.4g} and speed {done.margins['speed']:.4g} "
            "reserved",
            soft_wrap=True,
        )
    return calibrated.margins, calibration.plain(calibrated.rounds)


def _check(source: str, args: Args, runs: Runs, console: Console) -> None:
    """Repeat a part of a certificate; `runs` has no folder, as a saved result is no repetition."""
    file = certificates.file_of(source)
    certificate = Certificate.load(file)
    checked = check.check(certificate, args.episodes, args.seed, runs)
    for phrase in checked.elsewhere:
        console.print(f"computed elsewhere: {phrase}", soft_wrap=True)
    differs = list(checked.differs)
    if certificate.name != file.stem:
        differs.append(f"name: {certificate.name!r}, expected {file.stem!r} as the file's")
    if differs:
        raise RefusedError(f"check: {certificate.name!r} cannot be repeated: {'; '.join(differs)}")
    console.print(
        f"{certificate.summary}; {checked.episodes} of them repeated, with the same entries and "
        f"least h {checked.least_h:+.6g}",
        soft_wrap=True,
    )


def _name(plant: str) -> str:
    """Return a file's name for a plant: its last part, and its function unless certify or make."""
    source, _, function = plant.partition(":")
    is_path = "/" in source or source.endswith((".py", ".json"))
    base = Path(source).stem if is_path else source
    name = base if function in ("", "certify", "make") else f"{base}-{function}"
    return re.sub(r"[^\w-]", "-", name)
