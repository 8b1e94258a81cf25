"""Whether certificates are true: known chances, least margins, plants that deserve none.

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

from hcbf_gym import wrappers
from hcbf_gym.errors import RefusedError, choose
from hcbf_gym.evaluation import chunks
from hcbf_gym.evaluation.certification import calibration, certify, own
from hcbf_gym.evaluation.certification.families import OwnFamily, SceneFamily
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.evaluation.statistics import counted, upper_bound
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.robots.walker import Walker

RESULTS = Path("results/certificates")
ROOT = Path(__file__).parents[1]
BOAT = f"{ROOT / 'examples' / 'boat.py'}:certify"
HUMANOID = ROOT / "tests/robots/contracts/berkeley_humanoid.json"

EPISODES, ALLOWED = 1640, 5
"""Of each repetition of the self-test."""
MOST_AT_BOUND = 6
"""Of 2,000 repetitions at ε that may pass: at 99.9 % two are expected."""
LEAST_AT_TENTH = 0.985
"""Share of repetitions at ε/10 that have to pass."""
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

    def run(self) -> own.Outcome:
        """Enter, or not."""
        enters = np.random.default_rng(self.seed).random() < self.chance
        return own.Outcome(-1.0 if enters else 1.0, np.inf, 1.0, 0)


def passes(job: tuple[float, int]) -> bool:
    """Return whether a plant of a known chance gets a certificate, in one repetition."""
    chance, seed = job
    frozen = certify.Frozen("coin", Coin(chance), None, (), EPISODES, ALLOWED, 0.999, seed)
    try:
        certify.draw(frozen, certify.Runs(None, workers=1, quiet=True))
    except RefusedError:
        return False
    return True


def selftest(repetitions: int) -> Table:
    """Certify plants whose chance is ε and ε/10, over and over."""
    bound = upper_bound(ALLOWED, EPISODES)
    rows, good = [], True
    for name, share in (("ε / 10", 0.1), ("ε", 1.0)):
        jobs = [(share * bound, seed) for seed in range(repetitions)]
        runs = chunks.run(passes, jobs, folder=RESULTS / "selftest", size=50, title=name)
        passed = sum(one for _, one in runs)
        least, most = (LEAST_AT_TENTH, 1.0) if share < 1.0 else (0.0, MOST_AT_BOUND / 2000)
        good = good and least <= passed / repetitions <= most
        rows.append((name, f"{share * bound:.2e}", str(repetitions), str(passed), _yes(good)))
    header = ("chance of entering", "which is", "repetitions", "passed", "as it must be")
    title = f"A certificate of {EPISODES} episodes with at most {ALLOWED} entries, ε = {bound:.2e}"
    return _told(Table(title, header, rows), good)


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
        runs = certify.Runs(RESULTS / "least" / name)
        found = certify.calibrated(family, plant.uncertainty, runs, episodes, 1.0 / episodes, 0)
        for constant in calibration.CONSTANTS:
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


def _none_enter(family: Any, margins: Uncertainty, episodes: int, runs: certify.Runs) -> bool:
    """Tell whether no fresh episode enters with these margins."""
    frozen = certify.Frozen("grid", family, margins, (), episodes, 0, 0.999, 1)
    try:
        certify.draw(frozen, runs)
    except RefusedError:
        return False
    return True


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
    runs = certify.Runs(None)
    share = 0.1 * upper_bound(0, episodes)
    try:
        found = certify.calibrated(family, plant.uncertainty, runs, episodes // 4, share, 0)
        frozen = certify.Frozen("asked", family, found.margins, (), episodes, 0, 0.999, 0)
        certify.draw(frozen, runs)
    except RefusedError as error:
        return str(error)
    return f"certified: {counted(0, episodes)}"


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
    part: Literal["selftest", "least", "undeserving"],
    repetitions: int = 2000,
    plants: tuple[str, ...] = tuple(PLANTS),
    episodes: int = MARGIN_EPISODES,
) -> None:
    """Run one part.

    Args:
        part: "selftest", "least" or "undeserving".
        repetitions: of the self-test.
        plants: of the grid search.
        episodes: of each round, and on each point of the grid.
    """
    RESULTS.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Callable[[], Table]] = {
        "selftest": functools.partial(selftest, repetitions),
        "least": functools.partial(least, plants, episodes),
        "undeserving": functools.partial(undeserving, episodes),
    }
    parts[part]()


if __name__ == "__main__":
    from benchmarks import certificates  # under its own name, by which workers find it

    tyro.cli(certificates.main)
