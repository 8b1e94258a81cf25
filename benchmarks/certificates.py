"""Whether certificates are true: known chances, shipped ones again, plants that deserve none.

``python -m benchmarks.certificates --part selftest`` runs one part, prints its table, and leaves a
JSON in ``results/certificates``; it fails where a part does not show what it must.
"""

import functools
import json
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console

from hcbf_gym import certificates, wrappers
from hcbf_gym.certificates import sequential
from hcbf_gym.errors import RefusedError
from hcbf_gym.evaluation import own_environment
from hcbf_gym.evaluation.attacked import Outcome
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.evaluation.tables import Table
from hcbf_lab.certification import certify, check
from hcbf_lab.certification.families import OwnFamily, SceneFamily
from hcbf_robots.walkers.walker import Walker

RESULTS = Path("results/certificates")
ROOT = Path(__file__).parents[1]
BOAT = f"{ROOT / 'examples' / 'boat.py'}:certify"
HUMANOID = ROOT / "tests/robots/contracts/berkeley_humanoid.json"

BOUND, CONFIDENCE = 1e-2, 0.999
"""Of each repetition of the self-test."""
MEANS = {0.1: 1074.0}
"""Share of ε → how many episodes are enough on average, as computed."""
FEW_BLOCKS = 20
"""Episodes of each shipped certificate that a release repeats."""
MARGIN_EPISODES = 600
"""Of plants that deserve none, in all."""


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
        return len(certify.draw(frozen, Runs(None, workers=1, quiet=True), at_most=100_000))
    except RefusedError:
        return 0


def selftest(repetitions: int) -> Table:
    """Certify plants whose chance is ε/10, ε/3 and ε, over and over."""
    doubt = 1.0 - CONFIDENCE
    spread = np.sqrt(doubt * (1.0 - doubt) / repetitions)
    rows, good = [], True
    for name, share in (("ε / 10", 0.1), ("ε / 3", 1.0 / 3.0), ("ε", 1.0)):
        jobs = [(share * BOUND, seed) for seed in range(repetitions)]
        runs = Runs(RESULTS / "selftest").over(needed, jobs, name)
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
    """Repeat a few blocks of every shipped certificate; for a release, before it is published."""
    rows, good = [], True
    for name, one in certificates.shipped().items():
        checked = check.check(one, FEW_BLOCKS, 0, Runs(None, quiet=True))
        good = good and not checked.differs
        rows.append((name, "; ".join(checked.differs) or f"{checked.episodes} repeated"))
    return _told(Table("Shipped certificates", ("certificate", "what came out"), rows), good)


def late(steps: int = 6) -> own_environment.Made:
    """Return the boat of `examples/boat.py` whose rudder answers late, which nobody declares."""
    env, plant = own_environment.make(BOAT)
    original, waiting = env.step, [np.zeros(2)] * steps

    def step(action: Any) -> Any:
        waiting.append(np.asarray(action))
        return original(waiting.pop(0))

    env.step = step  # type: ignore[method-assign]
    return own_environment.Made(env, plant)


def pushed() -> own_environment.Made:
    """Return the boat in a current towards the buoys, which its model leaves out like its drag."""
    env, plant = own_environment.make(BOAT)
    inner: Any = env.unwrapped
    original = env.step

    def step(action: Any) -> Any:
        nearest = min(inner.buoys[:-1], key=lambda buoy: buoy.h(inner.x))
        towards = np.asarray(nearest.center) - inner.x[:2]
        return original(np.asarray(action) + 2.0 * towards / np.linalg.norm(towards))

    env.step = step  # type: ignore[method-assign]
    return own_environment.Made(env, plant)


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
    runs = Runs(None)
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
    part: Literal["selftest", "undeserving", "shipped"],
    repetitions: int = 2000,
    episodes: int = MARGIN_EPISODES,
) -> None:
    """Run one part.

    Args:
        part: which.
        repetitions: of the self-test.
        episodes: of each plant that deserves none.
    """
    RESULTS.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Callable[[], Table]] = {
        "selftest": functools.partial(selftest, repetitions),
        "undeserving": functools.partial(undeserving, episodes),
        "shipped": shipped,
    }
    parts[part]()


if __name__ == "__main__":
    import benchmarks.certificates as module  # under its own name, by which workers find it

    tyro.cli(module.main)
