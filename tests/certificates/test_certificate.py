"""A certificate contradicts itself nowhere, and covers its own plant alone."""

import json
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import certificates, models, version
from hcbf_gym.barriers import Disc
from hcbf_gym.certificates import (
    BLOCK,
    Block,
    Certificate,
    Shown,
    Stratum,
    first_seed,
    library,
    sequential,
)
from hcbf_gym.certificates.parts import vacuous
from hcbf_gym.errors import CoverageWarning, InvalidInputError
from hcbf_gym.models import Coverage, CoveredBy, Uncertainty
from hcbf_gym.wrappers import SafetyFilter
from hcbf_lab.certification.mixture import SCENES
from hcbf_robots import VelocityFilter
from tests.certificates.plants import Mass, mass

pytestmark = pytest.mark.usefixtures("released")
MARGINS = Uncertainty(distance=0.03, speed=0.2)


def made(plant, margins=MARGINS, entered=1, bound=0.2, **changes):
    """Return a certificate of today whose first episodes entered."""
    episodes = sequential.episodes_needed(bound, entered, 1.0 - 0.999)
    full, rest = divmod(episodes, BLOCK)
    sizes = [*[BLOCK] * full, *[rest] * (rest > 0)]
    blocks = [Block(0, size, 50 * size, 0, 0, 0.01, None) for size in sizes]
    blocks[0] = blocks[0]._replace(entered=entered, least_h=-0.01 if entered else 0.01)
    least = blocks[0].least_h
    fields = {
        "name": "one", "plant": plant, "family": {"kind": "own"}, "words": ("One.",),
        "margins": margins, "calibration": (), "bound": bound, "confidence": 0.999, "attempt": 0,
        "first_seed": first_seed(0, 0), "version": version.release(), "commit": "0123abc",
        "versions": {}, "episodes": episodes, "entered": entered,
        "e_value": sequential.e_value(entered, episodes, bound), "least_h": least, "falls": 0,
        "alarms": 0, "shown": Shown(episodes, 0.05, 50),
        "strata": (Stratum("nearest", "random", episodes, entered, least),),
        "blocks": tuple(blocks),
    }  # fmt: skip
    return Certificate(**(fields | changes))


REGIONS = {"environment": "HCBF-Regions-v0", "scene": {"any of": ["random"]}}


def test_a_file_gives_back_the_certificate_that_was_saved(tmp_path):
    one = made(REGIONS)
    one.save(tmp_path / "one.json")
    assert Certificate.load(tmp_path / "one.json") == one
    data = json.loads((tmp_path / "one.json").read_text())
    assert {"episodes", "entered", "bound", "confidence", "e_value"} <= set(data)


def test_a_file_that_was_changed_is_refused(tmp_path):
    data = made(REGIONS).to_dict()
    data["margins"]["distance"] = 0.001
    with pytest.raises(InvalidInputError, match="the file was changed"):
        Certificate.from_dict(data)
    (tmp_path / "no.json").write_text("[")
    with pytest.raises(InvalidInputError, match="expected a readable JSON file"):
        Certificate.load(tmp_path / "no.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bound": 0.19}, "expected 5[0-9] as the bound gives it"),
        ({"entered": 0}, "expected 3[0-9] as the bound gives it"),
        ({"episodes": 60}, "got 5 blocks"),
        ({"confidence": 0.9}, "as the bound gives it"),
        ({"attempt": 1}, "as the try gives it"),
        ({"e_value": 2000.0}, "got e_value 2000"),
        ({"first_seed": 7}, "got first_seed 7"),
        ({"strata": ()}, "as the sum of strata"),
        ({"blocks": ()}, "0 blocks, expected one for every 10"),
        ({"falls": -1}, "falls: got -1"),
        ({"falls": 1}, "as the sum of blocks"),
        ({"least_h": np.nan}, "least_h"),
        ({"least_h": 0.02}, "as the least of strata"),
        ({"shown": Shown(3, 0.05, 50)}, "got pressed 3"),
        ({"shown": Shown(50, 0.05, 1)}, "got pressed 50|within 1 steps"),
        ({"margins": None, "bound": 1.0}, "expected a number between 0 and 1"),
    ],
)
def test_numbers_that_contradict_each_other_are_refused(change, message):
    with pytest.raises(InvalidInputError, match=message):
        replace(made(REGIONS), **change)


def test_episodes_that_put_nothing_to_the_test_give_no_certificate():
    assert "ended within 1 steps" in vacuous(Shown(100, 0.05, 1), 100)
    assert "hardly at stake" in vacuous(Shown(49, 90.0, 500), 100)
    assert vacuous(Shown(50, 0.05, 500), 100) == ""


def test_every_weighting_is_bounded_by_its_worst_family():
    one = made(REGIONS)
    assert one.weightings["scenes"] == pytest.approx(
        sequential.running_bound(1, one.episodes, one.doubt)
    )


def edits(data, rng):
    """Yield files in which one number, text or entry anywhere is another."""

    def leaves(node, path=()):
        items = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in items:
            if isinstance(value, dict | list) and value:
                yield from leaves(value, (*path, key))
            else:
                yield (*path, key), value

    every = list(leaves(data))
    while True:
        path, value = every[rng.integers(len(every))]
        changed = json.loads(json.dumps(data))
        entry = changed
        for key in path[:-1]:
            entry = entry[key]
        if isinstance(value, bool) or value is None:
            entry[path[-1]] = 1
        elif isinstance(value, int):
            entry[path[-1]] = value + int(rng.choice([-1, 1]))
        elif isinstance(value, float):
            entry[path[-1]] = value * 1.01 + 0.001
        else:
            entry[path[-1]] = f"{value}x"
        yield path, changed


def test_no_edit_of_any_field_passes_without_the_hash():
    data = made(REGIONS).to_dict()
    for (path, changed), _ in zip(edits(data, np.random.default_rng(0)), range(200), strict=False):
        assert path
        with pytest.raises(InvalidInputError):
            Certificate.from_dict(changed)


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("strata", 0, "entered"), 0, "one of them where its least h is below 0"),
        (("strata", 0, "episodes"), "25", "expected a whole number >= 0"),
        (("blocks", 0, 0), "1", "expected a whole number >= 0"),
        (("version",), "0.2", "expected one such as '0.2.0'"),
        (("version",), None, "expected one such as '0.2.0'"),
        (("commit",), "47fb8b", "expected '' or 7 to 40 hexadecimal digits"),
        (("commit",), None, "expected '' or 7 to 40 hexadecimal digits"),
        (("blocks", 0), 3, "as `hcbf certify` writes them"),
        (("strata", 0, "least_h"), None, "least_h"),
        (("margins", "distance"), np.nan, "expected JSON's terms"),
        (("plant", "environment"), np.inf, "expected JSON's terms"),
    ],
)
def test_a_malformed_entry_of_a_file_is_refused_in_words(where, value, message):
    data = made(REGIONS).to_dict()
    entry = data
    for key in where[:-1]:
        entry = entry[key]
    entry[where[-1]] = value
    with pytest.raises(InvalidInputError, match=message):
        Certificate.from_dict(data)


@pytest.mark.parametrize("bad", [1, 0.5, True, [], np.zeros(2), object])
def test_anything_but_a_certificate_is_refused_in_words_by_every_entry_point(bad):
    env = gym.make("HCBF-Regions-v0")
    ways = (
        lambda: certificates.load(bad),
        lambda: SafetyFilter(env, certificate=bad),
        lambda: VelocityFilter("cart", [], certificate=bad),
    )
    for way in ways:
        with pytest.raises(InvalidInputError, match=r"certificate: got .* expected a Certificate"):
            way()


def test_a_plant_is_the_certified_one_where_all_that_it_declares_is():
    one = made({"environment": "X", "v_max": {"from": 0.5, "to": 1.0}, "scene": {"any of": ["a"]}})
    declared = {"environment": "X", "v_max": 0.7, "scene": "a"}
    assert certificates.judged_by(one, declared) == (Coverage.COVERED, CoveredBy.NONE, ())
    elsewhere = certificates.judged_by(one, declared | {"scene": None})
    assert elsewhere == (Coverage.SCENE, CoveredBy.SCENE, ())
    assert certificates.judged_by(one, declared | {"v_max": 1.1}).covered is Coverage.OUTSIDE
    assert certificates.judged_by(one, {"environment": "X", "scene": "a"}).reasons
    judged = certificates.judged_by(one, declared | {"v_max": 2})
    assert judged.reasons == ("v_max 2 (tested: 0.5 to 1)",)


def covered(env):
    _, info = env.reset(seed=0)
    return info["safety_filter"]["covered"]


def test_covered_follows_the_certificate_of_the_filter(released):
    one = made(REGIONS, margins=Uncertainty(distance=0.03))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        inside = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), certificate=one)
        beside = SafetyFilter(
            gym.make("HCBF-Regions-v0", scenario="random-moving"), certificate=one
        )
    assert covered(inside) == Coverage.COVERED
    assert covered(beside) == Coverage.SCENE
    _, *_, info = inside.step(np.zeros(2))
    assert info["safety_filter"]["margin"][0] == 0.03


def test_a_certificate_of_another_plant_warns_and_covers_nothing():
    one = made(REGIONS | {"environment": "HCBF-A1Regions-v0"})
    with pytest.warns(CoverageWarning, match="'one' is of another plant: environment"):
        env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), certificate=one)
    assert covered(env) == Coverage.OUTSIDE
    assert env.plant.uncertainty == Uncertainty()


def test_a_plant_of_ones_own_is_identified_by_its_model_its_inputs_and_its_readers():
    env = Mass()
    declared = certificates.declared(mass(), env, None, {})
    one = made(declared)
    filtered = SafetyFilter(env, plant=mass(), certificate=one)
    assert covered(filtered) == Coverage.COVERED
    assert filtered.plant.uncertainty.distance == 0.03
    with pytest.warns(CoverageWarning, match="input set"):
        assert covered(SafetyFilter(env, plant=mass(2.9), certificate=one)) == Coverage.OUTSIDE
    other = made(declared | {"state": "function 0123"})
    with pytest.warns(CoverageWarning, match="state"):
        SafetyFilter(env, plant=mass(), certificate=other)


def test_a_plant_whose_episodes_showed_it_needs_no_sufficient_condition():
    """Where U cannot be shown to brake, a certificate that was earned there shows it."""
    plant = replace(mass(), input_set=models.Box(np.array([-0.3, -3.0]), np.array([0.3, 3.0])))
    env = Mass()
    one = made(certificates.declared(plant, env, None, {}), margins=Uncertainty())
    filtered = SafetyFilter(env, plant=plant, certificate=one)
    filtered._core.samples.fresh[:] = True
    filtered._core.coverage._coverage[:] = Coverage.COVERED
    filtered._core.coverage.check_scenes(np.array([Coverage.OUTSIDE]), filtered._core.samples.fresh)
    assert filtered._core.coverage._coverage[0] == Coverage.COVERED
    bare = SafetyFilter(env, plant=plant)
    bare._core.coverage._coverage[:] = Coverage.COVERED
    bare._core.coverage.check_scenes(np.array([Coverage.OUTSIDE]), bare._core.samples.fresh)
    assert bare._core.coverage._coverage[0] == Coverage.OUTSIDE


def differs(one, plant, env):
    return certificates.judged_by(one, certificates.declared(plant, env, None, {})).reasons


def test_a_plant_of_ones_own_is_identified_by_its_action_space():
    env = Mass()
    exact = replace(mass(), input_set=None)
    one = made(certificates.declared(exact, env, None, {}))
    assert not differs(one, exact, env)
    env.action_space = gym.spaces.Box(-2.0, 2.0, (2,), dtype=np.float64)
    assert "action space" in differs(one, exact, env)[0]


OTHER = {
    "another input set": {"input_set": models.Box.symmetric(20.0)},
    "another period": {"period": None},
    "another state": {"state": lambda env, observation, info: np.zeros(4)},
    "another barriers": {"barriers": [Disc("disc", 1, (3.0, 0.0), 0.5)]},
    "another brake": {"brake": (0.0, 0.0)},
    "another max age": {"max_age": 1.0},
    "another braking": {"braking": 9.0},
    "another to action": {"to_action": lambda u: 0.5 * u, "from_action": lambda a: 2.0 * a},
}


@pytest.mark.filterwarnings("ignore:.*period is not known")
@pytest.mark.parametrize("certificate", [None, "regions"])
@pytest.mark.parametrize("what", OTHER)
def test_a_plant_that_is_not_the_environments_own_is_not_covered(what, certificate, released):
    env = gym.make("HCBF-Regions-v0", scenario="random")
    plant = replace(env.unwrapped.plant, **OTHER[what])
    with pytest.warns(CoverageWarning, match=what):
        filtered = SafetyFilter(env, plant=plant, certificate=certificate)
    assert covered(filtered) == Coverage.OUTSIDE


@pytest.mark.parametrize("other", [{"turn": 9.0}, {"look_ahead": 0.6}, {"forward": 2.0}])
def test_another_axle_than_the_carts_own_is_not_covered(other, released):
    env = gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot="cart", scenario="random")
    own = env.unwrapped.plant
    assert covered(SafetyFilter(env, plant=own)) == Coverage.COVERED
    plant = replace(own, axle=own.axle._replace(**other))
    with pytest.warns(CoverageWarning, match="another axle"):
        filtered = SafetyFilter(env, plant=plant)
    assert covered(filtered) == Coverage.OUTSIDE


def test_lower_margins_than_the_environments_are_not_covered(released):
    env = gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot="cart", scenario="random")
    plant = replace(env.unwrapped.plant, uncertainty=Uncertainty())
    with pytest.warns(CoverageWarning, match="a lower uncertainty"):
        assert covered(SafetyFilter(env, plant=plant)) == Coverage.OUTSIDE


def test_shipped_certificates_say_what_their_plants_are_and_cover_every_family():
    assert {"regions", "cart"} <= set(certificates.shipped())
    for name, one in certificates.shipped().items():
        assert one.name == name
        assert set(SCENES) <= set(one.plant["scene"]["any of"])
        assert certificates.load(name) is one
    with pytest.raises(InvalidInputError, match="no-such"):
        certificates.load("no-such")


def test_a_shipped_certificate_is_found_by_its_name_and_any_other_by_its_path():
    assert certificates.file_of("cart") == library.FOLDER / "cart.json"
    assert certificates.file_of("elsewhere/cart.json") == Path("elsewhere/cart.json")
