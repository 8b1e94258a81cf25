"""A number for the promise: calibrate a plant's margins, freeze, certify on fresh episodes.

PLANT is "regions", "a1", "a1-mixture", a walker's name or contract, or a function of your own that
returns (environment, plant), as FILE.py:FUNCTION or MODULE:FUNCTION. Runs until P(enter) is below
--bound, or that is hopeless. Writes NAME.json, which SafetyFilter takes as certificate=, and
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

LOWEST = 0.5  # the lowest cap on the speed of a walker, as a share of what its contract can do
SPEED_LEFT = 2.5
"""And of what the row of its speed limit reserves before calibration: an environment requires 2."""

RESUMED = "the same command resumes this run"  # printed after Ctrl-C


Share = Annotated[float, Range(0.0, 1.0 - 1e-12, above=True)]
Episode = Annotated[int, Range(0, MAX_COUNT)]


@dataclass(frozen=True)
class Args:
    """What to certify, and by how many episodes."""

    plant: Annotated[str | None, tyro.conf.Positional] = None
    """What is certified."""
    bound: Share = 0.01
    """What P(enter) is to be below. Where none enters, 859 episodes show 1 %, 8,630 show 1 ‰; each
    that enters takes a quarter more."""
    at_most: Count | None = None
    """Episodes to wait for; ten times those fewest if not given. More may be requested later."""
    confidence: Share = 0.999
    """Of the bound."""
    attempt: Annotated[int, Range(0, 50), tyro.conf.arg(name="try")] = 0
    """Where a plant may be tried again: which try this is, from 1, each with fresh episodes. The
    n-th spends 2⁻ⁿ of the doubt; 0 is the only try that there will be, and spends it all."""
    part: tuple[Episode, Episode] | None = None
    """First episode, from 0, and the one after the last, that this machine runs. Put the episodes
    of all machines into one folder, and run the command without --part."""
    episodes: Count = 50
    """Of --check: how many are repeated; all of them repeat the calibration, too."""
    calibration: Annotated[int, Range(0, MAX_COUNT)] = 200
    """Episodes of each round that sets the margins; 0 takes the plant's own."""
    scenes: tuple[str, ...] = ()
    """Families of random scenes, FILE.py:FAMILY of your own too; all covered ones if not given."""
    policies: tuple[str, ...] = ()
    """Attacks and policies, each as likely; all that can act in these scenes if not given. Your own
    too: file.py:function, module:function, model.zip, policy.onnx, policy.pt; a zip and a .pt hold
    pickles, which run code."""
    v_max: tuple[Positive, Positive] | None = None
    """Least and greatest cap on the speed of a walker [m/s]; if not given, half of what it can do,
    or as much as its speed row needs, to all of it."""
    steps: Count | None = None
    """The most that an episode takes; 1,000, or 500 of a plant of your own, if not given."""
    program: str = "lex-cbf-qp"
    """What the filter runs."""
    strict: Literal["rows", "gatekeeper"] = "rows"
    """What satisfies its strict conditions: rows, or verified manoeuvres."""
    seed: Seed = 0
    """Decides the episodes; those of the calibration are others than those of the certificate."""
    name: str | None = None
    """What the certificate is called; the plant's name if not given."""
    check: str | None = None
    """A certificate's file, or the name of a shipped one, of which a random part is repeated."""
    workers: Workers | None = None
    """Episodes that run at once [default: as many as the backend has CPUs]."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""
    output: Folder | None = None
    """Folder of the episodes and of the certificate; results/certify/NAME if not given."""


def main(args: Args) -> None:
    """Certify or check, and print what came out."""
    runs = Runs(None, args.workers, args.backend)
    runs.check()
    console = Console()
    if args.check is not None:
        _check(args, runs, console)
        return
    if args.plant is None:
        raise InvalidInputError("certify: got no plant, expected one, or --check FILE")
    if args.part is not None and not args.part[0] < args.part[1]:
        first, end = args.part
        raise InvalidInputError(f"part: got {first} to {end}, expected 0 <= first < end")
    choose("program", args.program, dict.fromkeys(programs.names()))
    name = records.check_name("name", _name(args.plant) if args.name is None else args.name)
    family = family_of(args)
    folder = args.output or Path("results/certify") / name
    settings = {
        "plant": args.plant, "family": families.to_dict(family), "bound": args.bound,
        "confidence": args.confidence, "try": args.attempt, "seed": args.seed,
        "calibration": args.calibration, "versions": versions(),
    }  # fmt: skip
    check_folder(folder, records.plain(settings))
    _try(family, args.seed)
    open_folder(folder, records.plain(settings))
    runs = replace(runs, folder=folder / "episodes")
    frozen = certify.Frozen(
        name, family, None, (), args.bound, args.confidence, args.attempt, args.seed
    )
    console.print(f"{name}: {frozen.fewest:,} episodes, if none enters, for P ≤ {args.bound:.3g}")
    margins, rounds = _margins(args, family, runs, console)
    frozen = replace(frozen, margins=margins, calibration=rounds)
    if args.part is not None:
        seen = list(certify.episodes(frozen, runs, range(*args.part)))
        entered = sum(one.entered for one in seen)
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
        own = args.scenes or args.policies or "strict" in requested
        if args.plant == "a1-mixture" and own:
            raise InvalidInputError(
                "certify: got scenes, policies or strict with a1-mixture, which has its own"
            )
        return _able(args, replace(PLANTS[args.plant], **requested))
    if args.plant not in NAMES and not args.plant.endswith(".json"):
        raise InvalidInputError(
            f"certify: got the plant {args.plant!r}, expected one of {sorted([*PLANTS, *NAMES])}, "
            "a contract's path, module:function or file.py:function"
        )
    caps = caps_of(Walker.load(args.plant)) if args.v_max is None else args.v_max
    family = SceneFamily("HCBF-WalkerRegions-v0", {"robot": args.plant}, caps=caps, **requested)
    return _able(args, family)


def _able(args: Args, family: SceneFamily | A1Mixture) -> Family:
    """Return a family without the policies that cannot act in scenes that were requested."""
    if not args.scenes or args.policies or isinstance(family, A1Mixture):
        return family
    able = families.policies_in(family.env, family.options, args.scenes)
    return replace(family, policies=able)


def _try(family: Family, seed: int) -> None:
    """Refuse what is the user's own and fails in the first steps of a family's episodes."""
    if not isinstance(family, SceneFamily | OwnFamily):
        return
    for name, _ in family.policies:
        if not attacks.is_attack(base := name.removesuffix(families.GUIDED)):
            policies.check(base)
    own = [name for name, _ in family.policies if policies.is_own(name)]
    if isinstance(family, OwnFamily) and not own:
        own = [family.policies[0][0]]
    for name in own:
        if policies.is_own(name) and not attacks.is_attack(name):
            env, _ = certify.made(family)
            policies.try_out(name, env, seed)
            env.close()
        trial = replace(family, policies=((name, 1.0),), steps=2)
        try:
            families.run_seed(trial, None, seed)
        except HcbfError:
            raise
        except Exception as error:  # whatever a user's environment or attack raises
            reason = str(error).strip().partition("\n")[0]
            raise InvalidInputError(
                f"certify: got {type(error).__name__}: {reason} in the first steps of an episode "
                f"with the policy {name!r}, expected none"
            ) from error


def caps_of(walker: Walker) -> tuple[float, float]:
    """Return the least and the greatest cap on the speed of a walker [m/s]."""
    most = walker.command.forward
    response = walker.response or assumed(walker.command)
    reserved = uncertainty(response, CONTROL_DT).speed
    return min(max(LOWEST * most, SPEED_LEFT * reserved), most), most


PLANTS: dict[str, SceneFamily | A1Mixture] = {
    "regions": SceneFamily("HCBF-Regions-v0"),
    "a1": SceneFamily("HCBF-A1Regions-v0"),
    "a1-mixture": A1Mixture(),
}
"""name → family of episodes of the package's own plants, walkers apart."""


def _margins(
    args: Args, family: Family, runs: Runs, console: Console
) -> tuple[Uncertainty | None, tuple[Mapping[str, Any], ...]]:
    """Return margins and how they were found: calibrated, or the plant's own; None is its law."""
    if isinstance(family, A1Mixture):
        return None, ()
    plant, _ = certify.plant_of(family)
    if args.calibration == 0:
        return plant.uncertainty, ()
    found = certify.calibrated(
        family, plant.uncertainty, runs, args.calibration, args.bound / SAFER, args.seed
    )
    for one in found.rounds:
        console.print(
            f"{one.what}: {one.entered} of {one.episodes} entered, least h {one.least_h:+.4g}, "
            f"with distance {one.margins['distance']:.4g} and speed {one.margins['speed']:.4g} "
            "reserved",
            soft_wrap=True,
        )
    return found.margins, calibration.plain(found.rounds)


def _check(args: Args, runs: Runs, console: Console) -> None:
    """Repeat a part of a certificate; what was kept would be no repetition."""
    assert args.check is not None
    file = certificates.file_of(args.check)
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
    """Return a plant's name as a file may have it: of a path the last part, of a function both."""
    stem, _, function = plant.partition(":")
    base = Path(stem).stem if "/" in stem or stem.endswith((".py", ".json")) else stem
    whole = f"{base}-{function}" if function not in ("", "certify", "make") else base
    return re.sub(r"[^\w-]", "-", whole)
