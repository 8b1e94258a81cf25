"""Whether certificates are true: known chances, least margins, plants that deserve none.

``python -m benchmarks.certificates --part selftest`` runs one part, prints its table, and leaves a
JSON in ``results/certificates``; it fails where a part does not show what it must.
"""

import functools
import json
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console

from hcbf_gym import certificates, wrappers
from hcbf_gym.certificates import Certificate, sequential
from hcbf_gym.certificates.certificate import CALIBRATED
from hcbf_gym.errors import HcbfError, InvalidInputError, RefusedError, choose
from hcbf_gym.evaluation import chunks
from hcbf_gym.evaluation.attacked import Outcome
from hcbf_gym.evaluation.certification import certify, check, own
from hcbf_gym.evaluation.certification.families import OwnFamily, SceneFamily
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.robots.walker import Walker

RESULTS = Path("results/certificates")
ROOT = Path(__file__).parents[1]
BOAT = f"{ROOT / 'examples' / 'boat.py'}:certify"
HUMANOID = ROOT / "tests/robots/contracts/berkeley_humanoid.json"

BOUND, CONFIDENCE = 1e-2, 0.999
"""Of each repetition of the self-test."""
MEANS = {0.1: 1074.0}
"""Share of ε → how many episodes are enough on average, as computed."""
FEW_BLOCKS = 20
"""Episodes of each shipped certificate that CI repeats."""
GRID = tuple(np.round(np.arange(0.95, 0.45, -0.05), 2).tolist())
"""Shares of a calibrated constant that the grid search tries, the largest first."""
MOST_MARGIN = 1.3
"""By how much a calibrated constant may exceed the least that passes."""
MARGIN_EPISODES = 600
"""On each point of the grid, and in each round of a calibration."""


@dataclass(frozen=True)
class Coin:
    """Episodes that enter with a known chance.

    Args:
        chance: of entering.
    """

    chance: float
    files = ()

    def episode(self, seed: int) -> "Toss":
        """Return the episode of a seed."""
        return Toss(self.chance, seed)


@dataclass(frozen=True)
class Toss:
    """One episode of `Coin`.

    Args:
        chance: of entering.
        seed: decides whether.
    """

    chance: float
    seed: int
    attack: str = "toss"
    scenario: str = "own"
    filter_options = None

    def run(self) -> Outcome:
        """Enter, or not."""
        enters = np.random.default_rng(self.seed).random() < self.chance
        return Outcome(-1.0 if enters else 1.0, first_h=1.0)


def needed(job: tuple[float, int]) -> int:
    """Return after how many episodes a plant of a known chance is certified; 0 where it is not."""
    chance, seed = job
    coin: Any = Coin(chance)  # it has no plant
    frozen = certify.Frozen("coin", coin, None, (), BOUND, CONFIDENCE, seed=seed)
    try:
        return len(certify.draw(frozen, chunks.Runs(None, workers=1, quiet=True), at_most=100_000))
    except RefusedError:
        return 0


def selftest(repetitions: int) -> Table:
    """Certify plants whose chance is ε/10, ε/3 and ε, over and over."""
    doubt = 1.0 - CONFIDENCE
    spread = np.sqrt(doubt * (1.0 - doubt) / repetitions)
    rows, good = [], True
    for name, share in (("ε / 10", 0.1), ("ε / 3", 1.0 / 3.0), ("ε", 1.0)):
        jobs = [(share * BOUND, seed) for seed in range(repetitions)]
        runs = chunks.run(needed, jobs, folder=RESULTS / "selftest", size=50, title=name)
        ends = np.array([one for _, one in runs])
        passed, mean = float((ends > 0).mean()), float(ends[ends > 0].mean()) if ends.any() else 0.0
        slack = doubt + 3.0 * spread
        fits = passed <= slack if share == 1.0 else passed >= 1.0 - slack
        if share in MEANS:
            fits = fits and abs(mean / MEANS[share] - 1.0) <= 0.03
        good = good and fits
        rows.append((name, str(repetitions), f"{passed:.4f}", f"{mean:,.0f}", _yes(fits)))
    header = (
        "chance of entering",
        "repetitions",
        "share passed",
        "episodes, mean",
        "as it must be",
    )
    return _told(Table(f"Certificates of ε = {BOUND}, β = {doubt:.3g}", header, rows), good)


def shipped() -> Table:
    """Repeat a few blocks of every certificate that is shipped, but for those listed as stale."""
    rows, good = [], True
    for name, one in certificates.shipped().items():
        since = certificates.stale_since().get(name)
        if since is not None:
            rows.append((name, f"stale since {since}"))
            continue
        checked = check.check(one, FEW_BLOCKS, 0, chunks.Runs(None, quiet=True))
        good = good and not checked.differs
        rows.append((name, "; ".join(checked.differs) or f"{checked.episodes} repeated"))
    return _told(Table("Shipped certificates", ("certificate", "what came out"), rows), good)


def edited(path: Path, count: int) -> Table:
    """Edit a certificate's file at random, with the hash made anew, and repeat it as a whole."""
    data = json.loads(path.read_text(encoding="utf-8"))
    rng = np.random.default_rng(0)
    every = [leaf for leaf in _leaves(data) if leaf != ("hash",)]
    told: Counter[str] = Counter()
    missed = []
    for k in range(count):
        at = every[k] if k < len(every) else every[int(rng.integers(len(every)))]
        changed = json.loads(json.dumps(data))
        entry = functools.reduce(lambda node, key: node[key], at[:-1], changed)
        entry[at[-1]] = _other(entry[at[-1]], rng)
        try:
            Certificate.from_dict(changed)
            missed.append(f"{at} without its hash")
        except InvalidInputError:
            told["refused without its hash"] += 1
        try:
            one = Certificate.parse(changed)
        except HcbfError:
            told["refused with its hash"] += 1
            continue
        try:
            checked = check.check(one, one.episodes, 0, chunks.Runs(None, quiet=True))
            found = checked.differs or checked.elsewhere or one.name != path.stem
        except HcbfError:
            found = True
        told["told by --check" if found else "missed"] += 1
        if not found:
            missed.append(f"{at}: {entry[at[-1]]!r}")
    rows = [*((name, str(number)) for name, number in told.items()), *((m, "") for m in missed)]
    return _told(Table("Edits of every field", ("what", "edits"), rows), not missed)


def _leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the places of what is no list and no mapping."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, dict | list):
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key)


def _other(value: Any, rng: np.random.Generator) -> Any:
    """Return another value of the same kind."""
    if value is None or isinstance(value, bool):
        return 1
    if isinstance(value, int):
        return value + int(rng.choice([-1, 1]))
    if isinstance(value, float):
        return value + float(rng.choice([-1.0, 1.0])) * max(1e-3, 0.01 * abs(value))
    return f"{value}x"


PLANTS: dict[str, Any] = {
    "cart": SceneFamily("HCBF-WalkerRegions-v0", {"robot": "cart"}, caps=(0.6, 1.2)),
    "regions": SceneFamily("HCBF-Regions-v0"),
    "boat": OwnFamily(BOAT, steps=300),
}


def least(plants: tuple[str, ...], episodes: int) -> Table:
    """Lower one calibrated constant at a time, step by step, until some episode enters."""
    rows, good = [], True
    for name in plants:
        family = choose("plant", name, PLANTS)
        plant, _ = certify.plant_of(family)
        runs = chunks.Runs(RESULTS / "least" / name)
        found = certify.calibrated(family, plant.uncertainty, runs, episodes, 1.0 / episodes, 0)
        for constant in CALIBRATED:
            value = getattr(found.margins, constant)
            smallest = value
            for share in GRID if value > 0.0 else ():
                fewer = found.margins._replace(**{constant: share * value})
                if not _none_enter(family, fewer, episodes, runs):
                    break
                smallest = share * value
            ratio = value / smallest if value > 0.0 else 1.0
            good = good and ratio <= MOST_MARGIN
            kept = [f"{getattr(plant.uncertainty, constant):.4f}", f"{value:.4f}"]
            rows.append((name, constant, *kept, f"{smallest:.4f}", f"{ratio:.2f}"))
    header = ("plant", "constant", "declared", "calibrated", "least that passes", "ratio")
    title = f"One constant at a time, {episodes} episodes at each point of the grid"
    return _told(Table(title, header, rows), good)


def _none_enter(family: Any, margins: Uncertainty, episodes: int, runs: chunks.Runs) -> bool:
    """Tell whether no fresh episode enters with these margins."""
    frozen = certify.Frozen("grid", family, margins, (), BOUND, seed=1)
    return not any(one.entered for one in certify.in_order(frozen, runs, range(episodes)))


def late(steps: int = 6) -> own.Made:
    """Return the boat of `examples/boat.py` whose rudder answers late, which nobody declares."""
    env, plant = own.make(BOAT)
    original, waiting = env.step, [np.zeros(2)] * steps

    def step(action: Any) -> Any:
        waiting.append(np.asarray(action))
        return original(waiting.pop(0))

    env.step = step  # type: ignore[method-assign]
    return own.Made(env, plant)


def pushed() -> own.Made:
    """Return the boat in a current towards the buoys, which its model leaves out like its drag."""
    env, plant = own.make(BOAT)
    inner: Any = env.unwrapped
    original = env.step

    def step(action: Any) -> Any:
        nearest = min(inner.buoys[:-1], key=lambda buoy: buoy.h(inner.x))
        towards = np.asarray(nearest.center) - inner.x[:2]
        return original(np.asarray(action) + 2.0 * towards / np.linalg.norm(towards))

    env.step = step  # type: ignore[method-assign]
    return own.Made(env, plant)


def eager_humanoid(folder: Path) -> SceneFamily:
    """Return episodes of the humanoid of which a file says that it brakes with 5 m/s² and more."""
    walker = Walker.load(HUMANOID)
    assert walker.response is not None
    contract = json.loads(HUMANOID.read_text(encoding="utf-8"))
    contract["mjcf"] = str(walker.mjcf)
    contract["policy"] = str(walker.source.parent / walker.policy)
    path = folder / "eager.json"
    path.write_text(json.dumps(contract), encoding="utf-8")
    replace(walker.response, braking=8.0).save(Walker.load(path).response_file)
    return SceneFamily("HCBF-WalkerRegions-v0", {"robot": str(path)}, caps=(0.8, 0.8))


def undeserving(episodes: int) -> Table:
    """Ask certificates of plants that do not deserve one."""
    me = "benchmarks.certificates"
    rows, good = [], True
    with tempfile.TemporaryDirectory() as folder:
        families: dict[str, Callable[[], Any]] = {
            "a delay of .3 s behind the filter's back": lambda: OwnFamily(f"{me}:late", steps=200),
            "a current that the model leaves out": lambda: OwnFamily(f"{me}:pushed", steps=200),
            "a humanoid at U = 5 m/s²": lambda: eager_humanoid(Path(folder)),
        }
        for name, make in families.items():
            family = make()
            said = _asked(family, episodes)
            good = good and not said.startswith("certified")
            rows.append((name, said))
    warned = another()
    rows.append(("a certificate on another plant", warned or "no warning"))
    return _told(
        Table("Plants that deserve none", ("plant", "what is said"), rows), good and warned
    )


def _asked(family: Any, episodes: int) -> str:
    """Return what is said of a plant: a refusal, or a bound."""
    plant, _ = certify.plant_of(family)
    runs = chunks.Runs(None)
    bound = sequential.running_bound(0, episodes, 1.0 - CONFIDENCE)
    try:
        found = certify.calibrated(family, plant.uncertainty, runs, episodes // 4, 0.1 * bound, 0)
        frozen = certify.Frozen("asked", family, found.margins, (), bound)
        certify.draw(frozen, runs)
    except RefusedError as error:
        return str(error)
    return f"certified: {bound:.2%}"


def another() -> str:
    """Return what the filter says of the cart's certificate on the reduced-order robot."""
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        env = gym.make("HCBF-Regions-v0", scenario="random")
        wrappers.SafetyFilter(env, certificate="cart").close()
    return "; ".join(str(one.message) for one in raised if "another plant" in str(one.message))


def _yes(good: bool) -> str:
    return "yes" if good else "no"


def _told(table: Table, good: Any) -> Table:
    """Print a table, and fail where it does not show what it must."""
    Console(width=160).print(table.rich())
    name = table.title.partition(",")[0]
    write_json(RESULTS / f"{'-'.join(name.lower().split())}.json", table.rows)
    if not good:
        raise SystemExit(f"certificates: {name}: not as it must be")
    return table


def main(
    part: Literal["selftest", "least", "undeserving", "shipped", "edited"],
    repetitions: int = 2000,
    plants: tuple[str, ...] = tuple(PLANTS),
    episodes: int = MARGIN_EPISODES,
    file: Path = Path("boat.json"),
    edits: int = 200,
) -> None:
    """Run one part.

    Args:
        part: which.
        repetitions: of the self-test.
        plants: of the grid search.
        episodes: of each round, and on each point of the grid.
        file: a certificate whose fields are edited.
        edits: how many.
    """
    RESULTS.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Callable[[], Table]] = {
        "selftest": functools.partial(selftest, repetitions),
        "least": functools.partial(least, plants, episodes),
        "undeserving": functools.partial(undeserving, episodes),
        "shipped": shipped,
        "edited": functools.partial(edited, file, edits),
    }
    parts[part]()


if __name__ == "__main__":
    import benchmarks.certificates as module  # under its own name, by which workers find it

    tyro.cli(module.main)
