"""Calibrate, freeze, certify: margins cover the needs, and no number comes without its episodes."""

import json
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import tyro

from hcbf_gym import certificates, loading, version
from hcbf_gym.barriers import Disc
from hcbf_gym.certificates import BLOCK, Certificate
from hcbf_gym.errors import InvalidInputError, RefusedError, SafetyWarning
from hcbf_gym.evaluation import jobs, own_environment
from hcbf_gym.evaluation.jobs import Runs, versions
from hcbf_gym.models import Reason, Uncertainty
from hcbf_gym.policies import learned
from hcbf_gym.wrappers import SafetyFilter
from hcbf_lab.certification import calibration, certify, check, command, exact_path, families, page
from hcbf_lab.certification.command import PLANTS
from hcbf_lab.certification.families import OwnFamily, SceneFamily, Seen
from hcbf_robots import Walker
from tests.needs import needs
from tests.robots import walkers

BOAT = f"{Path(__file__).parents[2] / 'examples' / 'boat.py'}:certify"


def test_the_reserve_is_more_than_any_need_and_grows_as_fewer_may_need_more():
    needs = np.random.default_rng(0).exponential(0.01, 400)
    some, fewer = (calibration.quantile(needs, share) for share in (1e-2, 1e-4))
    assert needs.max() < some <= fewer
    assert fewer <= calibration.BEYOND[1] * needs.max()
    assert calibration.quantile([-0.1, -0.2], 1e-3) == 0.0


def seen(least_h, speed_h=9.0, first_h=1.0, alarm=0, pressed=True):
    return Seen("nearest", "own", least_h, speed_h, first_h, False, alarm, 100, pressed)


def plant(need, first_h=1.0, alarm=0, follows=1.0):
    """Return what runs episodes of a plant that needs up to `need` metres."""

    def run(margins, seeds, title):
        needs = [need * np.random.default_rng(s).uniform(0.5, 1.0) for s in seeds]
        reserved = follows * margins.distance
        return [seen(reserved - n, first_h=first_h, alarm=alarm) for n in needs]

    return run


def calibrated(run, start=0.0, attack=None):
    return calibration.calibrate(Uncertainty(distance=start), run, attack, 50, 1e-3, 0)


@pytest.mark.parametrize("start", [0.0, 0.01, 0.2])
def test_margins_come_down_or_up_to_what_is_needed(start):
    found = calibrated(plant(0.05), start)
    assert 0.05 <= found.margins.distance <= 0.065
    assert found.rounds[-1].entered == 0


def test_a_model_that_is_exact_gets_no_margin_at_all():
    assert calibrated(plant(-0.01)).margins == Uncertainty()


def test_what_a_search_finds_raises_the_margins():
    def attack(margins, tried, title):
        return plant(0.1)(margins, [seed for seed, _ in tried], title)

    found = calibrated(plant(0.05), attack=attack)
    assert found.margins.distance >= 0.1
    assert [one.what for one in found.rounds].count("search") == 2


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (plant(0.05, follows=0.0), "after 4 rounds 50 of 50 episodes of the last round still"),
        (plant(0.5, first_h=0.4), "leaves no room"),
        (plant(-0.1, alarm=int(Reason.INPUT)), "alarms in 50 of 50 episodes"),
    ],
)
def test_a_plant_that_does_not_deserve_margins_is_refused(run, message):
    with pytest.raises(RefusedError, match=message):
        calibrated(run)


def test_a_refusal_states_the_margins_with_which_the_last_episodes_entered():
    reserved = []

    def run(margins, seeds, title):
        reserved.append(margins.distance)
        return plant(0.05, follows=0.0)(margins, seeds, title)

    with pytest.raises(RefusedError) as raised:
        calibrated(run)
    assert f"entered, with {reserved[-1]:.3g} m and" in str(raised.value)


def test_a_speed_limit_of_which_the_margin_leaves_nothing_is_refused():
    def run(margins, seeds, title):
        return [seen(1.0, margins.speed - 0.3, 2.0) for _ in seeds]

    with pytest.raises(RefusedError, match="leaves no speed"):
        calibration.calibrate(Uncertainty(), run, None, 50, 1e-3, 0, v_max=0.5)


def test_a_search_goes_where_episodes_get_worse():
    def attack(margins, tried, title):
        return [seen(1.0 - p[0]) for _, p in tried]

    found = calibration.search(Uncertainty(), attack, 0)
    first, last = found[: calibration.POPULATION], found[-calibration.POPULATION :]
    assert np.mean([s.least_h for s in last]) < np.mean([s.least_h for s in first]) - 0.1


def test_a_family_comes_back_from_its_json_with_the_same_episodes():
    for family in (
        SceneFamily("HCBF-WalkerRegions-v0", {"robot": "cart"}, caps=(0.6, 1.2)),
        SceneFamily("HCBF-Regions-v0", policies=(("edge", 3.0), ("pd guided", 1.0))),
        OwnFamily(BOAT, steps=20),
        *PLANTS.values(),
    ):
        again = families.from_dict(json.loads(json.dumps(families.to_dict(family))))
        assert families.to_dict(again) == families.to_dict(family)  # or a check would refuse it
        assert [again.episode(s) for s in range(20)] == [family.episode(s) for s in range(20)]


def test_policies_are_drawn_by_their_shares():
    family = SceneFamily("HCBF-Regions-v0", policies=(("edge", 3.0), ("pd guided", 1.0)))
    drawn = [family.episode(seed) for seed in range(400)]
    guided = [e for e in drawn if e.attack == "pd"]
    assert len(guided) == pytest.approx(100, abs=25)
    assert all(e.filter_options["guidance"] == "geodesic" for e in guided)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("no_such_module:make", "expected module:function or file.py:function"),
        ("no_such.py:make", "no file no_such.py"),
        ("json:dumps", "expected a function that returns"),
    ],
)
def test_a_function_that_is_no_plant_is_refused(source, message, monkeypatch):
    monkeypatch.setattr(json, "dumps", lambda: 3)
    with pytest.raises(InvalidInputError, match=message):
        own_environment.make(source)


FROZEN = certify.Frozen("boat", OwnFamily(BOAT, steps=40), Uncertainty(), (), 0.4, seed=3)


def boat(folder, at_most=None, frozen=FROZEN):
    runs = Runs(folder, workers=1, quiet=True)
    return certify.certify(frozen, runs, at_most)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A small certificate of the boat."""
    return boat(tmp_path_factory.mktemp("whole"))


def test_it_is_the_same_however_it_was_stopped_or_killed(tmp_path, whole):
    with pytest.raises(RefusedError, match="0 of 10 entered"):
        boat(tmp_path, at_most=10)
    next(iter(tmp_path.glob("*.job"))).unlink()  # one was lost
    assert boat(tmp_path) == whole
    assert whole.e_value >= 1000.0
    text = page.page(whole)
    assert "## Limits" in text
    assert f"≤ {whole.bound:.3g}" in text


def test_episodes_of_several_machines_in_one_folder_are_those_of_one(tmp_path, whole, monkeypatch):
    together = tmp_path / "together"
    together.mkdir()
    for first, end in ((13, whole.episodes), (0, 13)):
        runs = Runs(tmp_path / f"from {first}", workers=1, quiet=True)
        assert len(list(certify.episodes(FROZEN, runs, range(first, end)))) == end - first
        for file in runs.folder.iterdir():
            file.rename(together / file.name)
    kept = {file.name for file in together.iterdir()}
    assert boat(together) == whole
    assert {file.name for file in together.iterdir()} == kept  # nothing ran again
    for module in (jobs, certify):
        monkeypatch.setattr(module, "versions", lambda: {"hcbf-gym": whole.version, "numpy": "1"})
    assert boat(together, frozen=FROZEN) == replace(whole, versions={"numpy": "1"})
    assert len(list(together.iterdir())) == 2 * len(kept)  # another version is other work


def test_a_try_of_several_spends_less_on_other_seeds():
    third = replace(FROZEN, attempt=3)
    assert third.doubt == pytest.approx(FROZEN.doubt / 8)
    assert (third.fewest > FROZEN.fewest, third.first_seed - FROZEN.first_seed) == (True, 3_000_000)


def test_a_part_repeats_and_a_forged_file_does_not(whole, tmp_path):
    runs = Runs(None, workers=1, quiet=True)
    checked = check.check(whole, 5, 0, runs)
    assert (checked.episodes, checked.differs, checked.elsewhere) == (BLOCK, (), ())
    first = whole.blocks[0]
    forged = {
        "words": replace(whole, words=("A boat.",)),
        "plant": replace(whole, plant={"environment": "Boat"}),
        "margins": replace(whole, margins=whole.margins._replace(body=0.1)),
        "strata": replace(whole, strata=(replace(whole.strata[0], policy="x"), *whole.strata[1:])),
        "block": replace(whole, blocks=(first._replace(steps=first.steps + 1), *whole.blocks[1:])),
    }
    for what, one in forged.items():
        differs = check.check(Certificate.from_dict(one.to_dict()), 30, 0, runs).differs
        assert any(phrase.startswith(what) for phrase in differs), what
    other = replace(whole, version="0.1.0", versions=dict(whole.versions) | {"numpy": "1"})
    assert len(check.check(other, 5, 0, runs).elsewhere) == 2


FILES = sorted(
    file
    for folder in (
        Path(certificates.__path__[0]) / "shipped",
        Path(__file__).parents[2] / "docs" / "results" / "certificates",
    )
    for file in folder.glob("*.json")
)
NEEDED = {
    "go1": walkers.needed("go1"),
    "berkeley_humanoid": walkers.needed("berkeley_humanoid"),
    "unicycle": (needs("jax"),),
}
"""What plants need that the extra `test` does not bring."""


@pytest.mark.parametrize(
    "file",
    [pytest.param(file, id=file.stem, marks=NEEDED.get(file.stem, ())) for file in FILES],
)
@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.LoweredWarning")
def test_plant_words_and_family_of_every_file_are_those_that_are_derived_today(file):
    earned = certificates.load(file)
    family = families.from_dict(earned.family)
    python, here = earned.versions["python"], versions()["python"]
    if isinstance(family, OwnFamily) and python.split(".")[:2] != here.split(".")[:2]:
        pytest.skip(f"its plant's functions were hashed as the bytecode of Python {python}")
    if earned.version == version.release():  # another version's plants and words are its own
        assert check.stated_otherwise(earned, family) == []


DRIFTING = """
import gymnasium as gym, hcbf_gym, numpy as np
from hcbf_gym import barriers, models

class Drifting(gym.Env):
    action_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = np.array([self.np_random.uniform(-0.2, -0.1), 0.0, 0.0, 0.0])
        return self.x.copy(), {}

    def step(self, action):
        self.x[0] += 0.02
        return self.x.copy(), 0.0, False, False, {}

def certify():
    wall = barriers.HalfPlane("wall", 1, (-1.0, 0.0), 0.0)
    state = lambda env, observation, info: env.x.copy()
    return Drifting(), hcbf_gym.Plant(models.DoubleIntegrator(), [wall], state, period=0.02)
"""


def asked(tmp_path, text, steps=12, bound=0.4):
    """Return what is asked of a plant that a text describes."""
    (tmp_path / "mine.py").write_text(text)
    family = OwnFamily(f"{tmp_path / 'mine.py'}:certify", steps=steps)
    return certify.Frozen("mine", family, Uncertainty(), (), bound)


UNDESERVED = {
    "a start inside": (
        "self.np_random.uniform(-0.2, -0.1)",
        "0.01",
        r"P\(enter\) is above 0.2, where none ever comes",
    ),
    "an unseeded draw": ("self.np_random.uniform(-0.2, -0.1)", "-1.0 - np.random.rand()", "seed"),
    "min_h of one number": ("False, {}", "False, {'min_h': -1.0}", "expected 1 numbers"),
    "min_h in words": ("False, {}", "False, {'min_h': ['a']}", "expected 1 numbers"),
    "nothing declared": ("period=0.02", "period=0.02, declared={}", "any plant matches"),
}


@pytest.mark.parametrize("what", UNDESERVED)
def test_what_a_plant_does_wrong_is_not_certified(what, tmp_path):
    old, new, message = UNDESERVED[what]
    text = DRIFTING.replace("self.x[0] += 0.02", "self.x[0] -= 0.02").replace(old, new)
    with pytest.raises((RefusedError, InvalidInputError), match=message):
        boat(None, frozen=asked(tmp_path, text, steps=3))


MOVING = DRIFTING.replace(
    "self.x[0] += 0.02", "self.x[2:] += 0.02 * action; self.x[:2] += 0.02 * self.x[2:]"
)
VACUOUS = {
    "a region far away": ("(-1.0, 0.0), 0.0)", "(-1.0, 0.0), -100.0)", "hardly at stake"),
    "an end after one step": ("0.0, False, False", "0.0, True, False", "ended within 1 steps"),
    "a reset inside": (
        "return self.x.copy(), 0.0, F",
        "self.k = getattr(self, 'k', 0) + 1\n        if self.k % 30 == 0: self.x[:] = -1.0"
        "\n        return self.x.copy(), 0.0, F",
        "a state that jumps",
    ),
    "a min_h of 1": ("False, {}", "False, {'min_h': [1.0]}", "none ever comes"),
}


@pytest.mark.parametrize("what", VACUOUS)
def test_an_idle_test_is_not_certified(what, tmp_path):
    old, new, message = VACUOUS[what]
    text = (DRIFTING if "min_h" in what else MOVING).replace(old, new)
    assert new in text
    with pytest.raises((RefusedError, InvalidInputError), match=message):
        boat(None, frozen=asked(tmp_path, text, steps=60))


LAGGED = MOVING.replace("action;", "(action - LAG * self.x[2:]);")
"""A plant whose drag is in a file; the attackers' model has none of it."""
READ = "global LAG\n        LAG = float(Path(FILE).read_text())\n\n"
PLACES = {  # where the file is read
    "module": ("class Drifting", "LAG = float(Path(FILE).read_text())\n\nclass Drifting"),
    "function": ("def certify():\n", f"def certify():\n    if True:\n        {READ}"),
    "constructor": ("    def reset", f"    def __init__(self):\n        {READ}    def reset"),
    "reset": ("super().reset(seed=seed)\n", f"super().reset(seed=seed)\n        {READ}"),
}


def reading(file, place, text):
    """Return the text of a plant that reads LAG from a file."""
    old, new = PLACES[place]
    return f"from pathlib import Path\nFILE = {str(file)!r}\n" + text.replace(old, new)


@pytest.mark.parametrize("place", PLACES)
def test_episodes_of_other_data_are_not_taken_wherever_a_plant_reads_them(place, tmp_path):
    file = tmp_path / "lag"
    text = reading(file, place, LAGGED)

    def episodes(lag, folder):
        for forget in (loading._of_file.cache_clear, loading._opened.clear):
            forget()  # as in a new process
        file.write_text(lag)
        frozen = asked(tmp_path, text, steps=40)
        runs = Runs(tmp_path / folder, workers=1, quiet=True)
        return list(certify.episodes(frozen, runs, range(20)))

    slow = episodes("0.05", "kept")
    assert episodes("0.05", "kept") == slow
    fast = episodes("-1.0", "kept")
    assert fast == episodes("-1.0", "empty") != slow


def test_a_certificate_of_a_plant_whose_data_changed_while_it_ran_is_refused(
    tmp_path, monkeypatch, whole
):
    file = tmp_path / "lag"
    file.write_text("0.05")
    text = reading(file, "function", MOVING).replace("(-1.0, 0.0), 0.0)", "(-1.0, 0.0), LAG)")
    frozen = asked(tmp_path, text, steps=40)
    original = certify.draw

    def draw(*arguments):
        seen = original(*arguments)
        file.write_text("0.06")
        return seen

    monkeypatch.setattr(certify, "draw", draw)
    with pytest.raises(RefusedError, match="lag changed while episodes ran"):
        boat(tmp_path / "chunks", frozen=frozen)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("threading.Lock()", "what cannot be hashed: .*environment.part: TypeError: cannot pickle"),
        ("np.random.default_rng().random()", r"another \['environment.part'\]"),
    ],
)
def test_a_plant_that_no_certificate_could_cover_is_refused_at_once(value, message, tmp_path):
    text = "import threading\n" + DRIFTING.replace(
        "    def reset", f"    def __init__(self):\n        self.part = {value}\n\n    def reset"
    )
    with pytest.raises(RefusedError, match=message):
        boat(None, frozen=asked(tmp_path, text))


def covers_its_own_barriers_alone(certificate):
    """The boat of a certificate is covered, and not with a list of other barriers."""
    env, plant = own_environment.make(BOAT)
    others = [Disc("other", 1, (3.0, 0.0), 0.5)]
    for of, covered in ((plant, 1), (replace(plant, barriers=others), 0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            env = SafetyFilter(env.unwrapped, plant=of, certificate=certificate)
            _, info = env.reset(seed=1)
            *_, stepped = env.step(np.array([3.0, 0.0]))
        assert info["safety_filter"]["covered"] == covered == stepped["safety_filter"]["covered"]


def test_the_command_leaves_a_certificate_that_the_filter_takes(tmp_path, capsys, released):
    def run(*more):
        command.main(tyro.cli(command.Args, args=[*more, "--workers", "1"]))

    run(
        BOAT, "--bound", "0.5", "--calibration", "10", "--steps", "40",
        "--output", str(tmp_path / "boat"),
    )  # fmt: skip
    file = tmp_path / "boat" / "boat.json"
    one = Certificate.load(file)
    assert one.entered == 0
    covers_its_own_barriers_alone(str(file))
    run("--check", str(file), "--episodes", "10")
    assert "with the same entries" in capsys.readouterr().out
    file.rename(file.with_name("other.json"))
    with pytest.raises(RefusedError, match="name: 'boat', expected 'other'"):
        run("--check", str(file.with_name("other.json")), "--episodes", "1")
    settings = json.loads((tmp_path / "boat" / "settings.json").read_text())
    assert settings["versions"] == versions()  # others are another study


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "got no plant"),
        (["nothing"], "expected one of"),
        (["regions", "--v-max", "0.5", "1.0"], "expected a walker"),
        ([BOAT, "--scenes", "random"], "draws its own"),
        (["regions", "--bound", "1"], "expected between 0 and 1"),
        (["regions", "--try", "50"], "try: got 50"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments, message, tmp_path):
    with pytest.raises(InvalidInputError, match=message):
        command.main(tyro.cli(command.Args, args=[*arguments, "--output", str(tmp_path / "a")]))


def test_the_exact_way_is_no_deeper_than_a_finer_look_and_no_shallower_than_the_environments():
    env = exact_path.EachMillisecond(gym.make("HCBF-Regions-v0", scenario="random-moving"))
    inner = env.unwrapped
    env.reset(seed=2)
    env.action_space.seed(2)
    for _ in range(30):
        x, time = inner.truth, inner.time
        u = env.action_space.sample()
        *_, info = env.step(u)
        fine = np.linspace(0.0, 0.02, 401)[1:, None]
        held = np.asarray(u, dtype=np.float64)
        way = np.hstack([x[:2] + x[2:] * fine + held * fine**2 / 2.0, x[2:] + held * fine])
        assert np.hypot(*way[-1, 2:]) < inner.scenario.v_max  # else the environment caps the speed
        h = inner.barrier_set.along(way, time + fine[:, 0]).min(axis=0)
        assert (info["min_h"] >= h - 1e-9).all()
        assert (
            info["min_h"]
            <= inner.barrier_set.values(inner.truth[None], np.array([inner.time]))[0] + 1e-9
        ).all()


def test_policies_that_cannot_act_in_scenes_are_left_out_unless_they_are_requested():
    env = "HCBF-Regions-v0"
    usual = [name for name, _ in families.policies_in(env, {}, ["random", "random-wide"])]
    larger = [name for name, _ in families.policies_in(env, {}, ["random", "random-map"])]
    assert set(learned.names()) <= set(usual)
    assert set(usual) - set(larger) == set(learned.names())
    family = command.family_of(command.Args(plant="regions", scenes=("random-map",)))
    assert not set(learned.names()) & {name for name, _ in family.policies}
    asked = command.Args(plant="regions", scenes=("random-map",), policies=("sac",))
    assert [name for name, _ in command.family_of(asked).policies] == ["sac"]


def test_the_lowest_cap_leaves_a_walker_speed_beside_what_its_row_reserves(tmp_path):
    cart = Walker.load("cart")
    contract = json.loads(cart.source.read_text()) | {"name": "swaying", "mjcf": str(cart.mjcf)}
    file = tmp_path / "swaying.json"
    file.write_text(json.dumps(contract))
    replace(cart.response, overshoot=0.3).save(tmp_path / "swaying.response.json")
    usual, swaying = (
        command.family_of(command.Args(plant=str(name))) for name in (cart.source, file)
    )
    assert usual.caps == (0.6, 1.2)
    assert 0.6 < swaying.caps[0] < swaying.caps[1] == 1.2
    certify.plant_of(swaying)  # an environment with the lowest cap leaves some speed
    most = replace(swaying, options={"robot": str(file), "v_max": swaying.caps[0]}, caps=None)
    certify.plant_of(most)


@pytest.mark.parametrize(
    ("pressed", "outcome"), [(80, ""), (46, ""), (44, "warned"), (39, "refused")]
)
def test_a_first_round_that_presses_too_little_is_reported_at_once(pressed, outcome):
    shown = [seen(1.0, first_h=2.0, pressed=k < pressed) for k in range(100)]
    if outcome == "refused":
        with pytest.raises(RefusedError, match="calibration: in 39 of 100 episodes"):
            calibration._check_stake(shown)
    elif outcome == "warned":
        with pytest.warns(SafetyWarning, match="there may be no certificate"):
            calibration._check_stake(shown)
    else:
        calibration._check_stake(shown)
