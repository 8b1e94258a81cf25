"""The judge: outside of one range covers nothing, with that reason, by every entry point."""

import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.alone import ALONE
from hcbf_gym import certificates, version
from hcbf_gym.certificates import judge
from hcbf_gym.certificates.ranges import parse_range
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.models import Coverage, CoveredBy
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from tests.certificates.plants import Mass, mass

KINDS = ({"any of"}, {"each"}, {"from"}, {"to"}, {"from", "to"})
SHIPPED = certificates.shipped()
FILTER = "filter of a plant that is not its model"
NAMES = {"unit", "words", "kind"}
DERIVED = {"position", "friction_derived"}  # what the mixture's own certificate drives


def kind(expected):
    found = set(expected) - {"unit", "words"} if isinstance(expected, dict) else set()
    return found if found in KINDS else set()


def ends(expected, declared):
    low, high = expected.get("from", -1e6), expected.get("to", 1e6)
    return [declared[end] if isinstance(end, str) else end for end in (low, high)]


def within(expected, declared, rng):
    """Return a value that lies in a range."""
    which = kind(expected)
    if which == {"any of"}:
        options = expected["any of"]
        return within(options[int(rng.integers(len(options)))], declared, rng)
    if which == {"each"}:
        parts = expected["each"]
        if isinstance(parts, dict):
            return {name: within(one, declared, rng) for name, one in parts.items()}
        return [within(one, declared, rng) for one in parts]
    if which:
        low, high = ends(expected, declared)
        number = float(rng.choice([low, high, rng.uniform(low, high)]))
        return number if rng.random() < 0.5 else [low, number]
    return expected


def beside(expected, declared, rng):
    """Return values that lie outside of a range, of which each leaves it by one thing."""
    which = kind(expected)
    if which == {"any of"}:
        options = expected["any of"]
        values = [v for one in options if kind(one) for v in beside(one, declared, rng)]
        return ["neither", 1e9, *(v for v in values if v not in options)]
    if which == {"each"}:
        whole = within(expected, declared, rng)
        parts = expected["each"]
        places = parts.items() if isinstance(parts, dict) else enumerate(parts)
        found = ["whole", [], {}]
        for place, one in places:
            for value in beside(one, declared, rng):
                changed = whole.copy()
                changed[place] = value
                found.append(changed)
        return found
    if which:
        low, high = ends(expected, declared)
        numbers = [low - 1e-6] * ("from" in which) + [high + 1e-6] * ("to" in which)
        return [*numbers, *([low, one] for one in numbers), float("nan"), None, True, "1", []]
    return ["another", -7.5, [expected]]


def drawn(ranges, rng):
    declared = {"friction_derived": 0.45, "alpha_gain": 10.0}
    return declared | {name: within(one, declared, rng) for name, one in ranges.items()}


RANGES = {name: (one.plant, CoveredBy.ARGUMENT) for name, one in SHIPPED.items()}
RANGES |= {name: (certificates.tested()[name], CoveredBy.FILTER) for name in ("filter", FILTER)}


@pytest.mark.parametrize("name", RANGES)
def test_each_value_outside_of_its_range_is_named_alone_and_all_inside_are_covered(name):
    ranges, reason = RANGES[name]
    rng = np.random.default_rng(0)
    for _ in range(8):
        declared = drawn(ranges, rng)
        assert judge(declared, ranges, reason=reason) == (Coverage.COVERED, CoveredBy.NONE, ())
        for argument, expected in ranges.items():
            if argument == "scene":
                continue
            for value in beside(expected, declared, rng):
                judged = judge(declared | {argument: value}, ranges, reason=reason)
                assert (judged.covered, judged.covered_by) == (Coverage.OUTSIDE, reason), value
                assert len(judged.reasons) == 1
                assert judged.reasons[0].startswith(f"{argument} ")
                assert judged.reasons[0].endswith(f"(tested: {parse_range(expected, {}).words})")
            missing = {k: v for k, v in declared.items() if k != argument}
            assert judge(missing, ranges).covered == Coverage.OUTSIDE
        for value in (0.0, None, "as ever"):  # no range includes it
            for tomorrow in ("payload of tomorrow", "payload_derived"):
                judged = judge(declared | {tomorrow: value}, ranges)
                assert judged.covered == Coverage.OUTSIDE
                assert judged.reasons == (f"{tomorrow} {value!r} (nothing is tested of it)",)


def test_one_argument_alone_may_be_left_for_its_wider_range():
    ranges = SHIPPED["a1-mixture"].plant
    alone = certificates.tested()["alone"]["HCBF-A1Regions-v0"]
    rng = np.random.default_rng(0)
    nominal = drawn(SHIPPED["a1-nominal"].plant, rng)
    for _ in range(20):
        for argument, expected in alone["ranges"].items():
            value = within(expected, nominal, rng)
            if isinstance(value, list):
                continue
            one = nominal | {argument: value}
            assert judge(one, ranges, alone).covered == Coverage.COVERED
            if value == ranges[argument]:
                continue
            assert judge(one, ranges).covered == Coverage.OUTSIDE
            others = {"terrain": "rough", "payload": [0.0, 1.0], "v_max": 1.2, "body": "footprint"}
            for other, changed in others.items():
                judged = judge(one | {other: changed}, ranges, alone)
                assert judged.covered_by == CoveredBy.ARGUMENT
                assert judged.reasons[0].startswith(f"alone {argument} and {other} ")
            two = "timestep" if argument != "timestep" else "feedback"
            both = one | {two: {"timestep": 0.004, "feedback": "rom"}[two]}
            assert judge(both, ranges, alone).covered == Coverage.OUTSIDE
            for value in beside(expected, nominal, rng):
                assert judge(nominal | {argument: value}, ranges, alone).reasons


def reported(env):
    """Return what the report of a reset and of a step say, which is the same."""
    _, info = env.reset(seed=0)
    first = info["safety_filter"]
    *_, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    for name in ("covered", "covered_by"):
        np.testing.assert_array_equal(info["safety_filter"][name], first[name])
        assert np.asarray(first[name]).dtype == np.int64
    return np.unique(first["covered"]).tolist(), np.unique(first["covered_by"]).tolist()


def regions(**options):
    return gym.make("HCBF-Regions-v0", **({"scenario": "random"} | options))


def batch(**options):
    env = gym.make_vec("HCBF-Regions-v0", num_envs=3, scenario="random")
    return VectorSafetyFilter(env, **options)


def cart(**options):
    return gym.make(
        "hcbf_robots:HCBF-WalkerRegions-v0", robot="cart", **({"scenario": "random"} | options)
    )


def by_gatekeeper():
    certificate = SHIPPED["regions"]
    return replace(certificate, family={**certificate.family, "strict": "gatekeeper"})


def moved(env):
    return replace(env.unwrapped.plant, period=0.01)


WAYS = {
    "the environment's arguments": (lambda: SafetyFilter(cart()), 1, CoveredBy.NONE),
    "terrain": (lambda: SafetyFilter(cart(terrain="rough")), 0, CoveredBy.ARGUMENT),
    "v_max": (lambda: SafetyFilter(cart(v_max=0.5)), 0, CoveredBy.ARGUMENT),
    "scene": (lambda: SafetyFilter(cart(scenario="paper-simulation")), 2, CoveredBy.SCENE),
    "the filter's arguments": (lambda: SafetyFilter(regions()), 1, CoveredBy.NONE),
    "rows": (lambda: SafetyFilter(regions(), rows="usual"), 0, CoveredBy.FILTER),
    "solver": (lambda: SafetyFilter(regions(), solver="daqp"), 0, CoveredBy.FILTER),
    "margin": (lambda: SafetyFilter(cart(), margin=0.2), 0, CoveredBy.FILTER),
    "alpha1": (lambda: SafetyFilter(cart(), alpha1=1.0), 0, CoveredBy.FILTER),
    "alpha2": (lambda: SafetyFilter(cart(), alpha2=2.5), 0, CoveredBy.FILTER),
    "alpha_speed": (lambda: SafetyFilter(cart(), alpha_speed=2.5), 0, CoveredBy.FILTER),
    "a batch": (batch, 1, CoveredBy.NONE),
    "a batch's rows": (lambda: batch(rows="usual"), 0, CoveredBy.FILTER),
    "another plant": (lambda: SafetyFilter(e := regions(), plant=moved(e)), 0, CoveredBy.PLANT),
    "a plant of one's own": (lambda: SafetyFilter(Mass(), plant=mass()), 0, CoveredBy.UNKNOWN),
    "one that states 1": (lambda: SafetyFilter(Mass(), plant=mass(covered=1)), 1, CoveredBy.NONE),
    "one that states 2": (lambda: SafetyFilter(Mass(), plant=mass(covered=2)), 2, CoveredBy.SCENE),
    "a certificate": (lambda: SafetyFilter(cart(), certificate="cart"), 1, CoveredBy.NONE),
    "a batch's certificate": (lambda: batch(certificate="regions"), 1, CoveredBy.NONE),
    "a certificate of another": (
        lambda: SafetyFilter(cart(), certificate="regions"), 0, CoveredBy.CERTIFICATE,
    ),
    "a batch's of another": (lambda: batch(certificate="cart"), 0, CoveredBy.CERTIFICATE),
    "a certificate's argument": (
        lambda: SafetyFilter(cart(body="footprint"), certificate="cart"), 0, CoveredBy.CERTIFICATE,
    ),
    "a certificate's program": (
        lambda: SafetyFilter(cart(), "cbf-qp", certificate="cart"), 0, CoveredBy.FILTER,
    ),
    "a certificate of rows": (
        lambda: SafetyFilter(regions(), certificate="regions", strict="gatekeeper"),
        0,
        CoveredBy.FILTER,
    ),
    "a certificate of the gatekeeper": (
        lambda: SafetyFilter(regions(), certificate=by_gatekeeper(), strict="gatekeeper"),
        1,
        CoveredBy.NONE,
    ),
    "a certificate of the gatekeeper, with rows": (
        lambda: SafetyFilter(regions(), certificate=by_gatekeeper()), 0, CoveredBy.FILTER,
    ),
    "a certificate's scene": (
        lambda: SafetyFilter(cart(scenario="paper-simulation"), certificate="cart"),
        2,
        CoveredBy.SCENE,
    ),
}  # fmt: skip


@pytest.mark.usefixtures("released")
@pytest.mark.parametrize("way", WAYS)
def test_every_entry_point_reports_whether_it_is_covered_and_why_not(way):
    make, covered, why = WAYS[way]
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        env = make()
    assert reported(env) == ([covered], [why])
    silent = covered > 0 or why == CoveredBy.UNKNOWN
    assert silent != any(one.category is CoverageWarning for one in raised)


VERSIONS = {  # version of the package, whether its shipped certificates cover, what is reported
    "the release": ("0.2.0", 1, None),
    "a candidate for it": ("0.2.0rc1", 1, None),
    "a development version": ("0.2.0.dev0", 0, "a development version: the filter works"),
    "one after the release": ("0.2.1", 0, "was earned for hcbf-gym 0.2.0, and this is 0.2.1"),
}


@pytest.mark.parametrize("which", VERSIONS)
def test_a_certificate_covers_in_its_own_version_alone_with_one_warning_a_process(
    which, monkeypatch
):
    number, covered, message = VERSIONS[which]
    monkeypatch.setattr(version, "VERSION", number)
    made = (
        lambda: SafetyFilter(regions()),
        batch,
        lambda: SafetyFilter(regions(), certificate="regions"),
        lambda: batch(certificate="regions"),
    )
    certificates.warn_of_version.cache_clear()
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        found = [reported(make()) for make in made]
    assert found == [([covered], [CoveredBy.NONE if covered else CoveredBy.VERSION])] * 4
    assert [message in str(one.message) for one in raised] == [True] * (message is not None)
    assert all(one.category is CoverageWarning for one in raised)


@pytest.mark.parametrize("stated", [1, 2])
def test_in_a_development_version_what_a_plant_states_of_itself_is_not_covered_either(
    stated, monkeypatch
):
    monkeypatch.setattr(version, "VERSION", "0.2.0.dev0")
    assert reported(SafetyFilter(Mass(), plant=mass(covered=stated))) == ([0], [CoveredBy.VERSION])


def test_a_release_ships_certificates_that_were_earned_for_it():
    if ".dev" not in version.VERSION:
        for one in SHIPPED.values():
            assert one.version == version.release()
            assert one.commit != "47fb8b2"  # of before the release


@pytest.mark.usefixtures("released")
def test_a_scene_that_changes_or_needs_too_much_is_reported():
    env = SafetyFilter(regions())
    env.reset(seed=0)
    env.unwrapped.change_scene(env.unwrapped.scenario)
    *_, info = env.step(np.zeros(2, dtype=np.float32))
    report = info["safety_filter"]
    assert (report["covered"], report["covered_by"]) == (2, CoveredBy.CHANGED)
    _, info = env.reset(seed=0)
    assert info["safety_filter"]["covered_by"] == CoveredBy.NONE
    env._core.samples.fresh[:] = True
    env._core.coverage.check_scenes(np.array([Coverage.OUTSIDE]), env._core.samples.fresh)
    assert env._core.coverage._reason[0] == CoveredBy.INPUTS


def leaves(value):
    """Return the numbers and names in a value of JSON, without `NAMES`."""
    if isinstance(value, dict):
        return [x for name, one in value.items() if name not in NAMES for x in leaves(one)]
    if isinstance(value, list):
        return [x for one in value for x in leaves(one)]
    return [] if value is None else [value]


def test_every_end_of_a_range_that_was_tested_alone_is_driven():
    alone = certificates.tested()["alone"]["HCBF-A1Regions-v0"]["ranges"]
    driven = [option for options in ALONE.values() for option in options.items()]
    assert {name for name, _ in driven} == set(alone)
    for name, expected in alone.items():
        ends = {end for end in leaves(expected) if end not in DERIVED}
        assert ends <= {end for one, value in driven if one == name for end in leaves(value)}, name
