"""A certificate covers the plant that it was earned on: all bytes and functions, in any process."""

import functools
import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hcbf_gym import Estimate, barriers, certificates
from hcbf_gym.certificates import identity
from hcbf_gym.certificates.declared import UNHASHABLE as CANNOT
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.models import CoveredBy
from hcbf_gym.wrappers import SafetyFilter
from tests.certificates import plants
from tests.certificates.plants import BASE, Mass
from tests.certificates.test_certificate import made
from tests.needs import needs

ROOT = Path(__file__).parents[2]


def stated(plant, env=None):
    return certificates.declared(plant, env or Mass(), None, {})


@pytest.mark.usefixtures("released")
def test_300_plants_that_differ_in_one_number_function_or_option_are_all_distinguished():
    pairs = 0
    for name, plant, others in plants.plants():
        known = stated(plant)
        one = made(known)
        assert not certificates.judged_by(one, stated(plant)).outside, name
        found = [json.dumps(known, sort_keys=True)]
        for where, other in others:
            now = stated(other)
            assert certificates.judged_by(one, now).outside, f"{name}: {where}"
            found.append(json.dumps(now, sort_keys=True))
        assert len(set(found)) == len(found), name
        pairs += len(found) - 1
    assert pairs >= 300


def test_equal_plants_are_equal_in_another_process():
    done = subprocess.run(
        [sys.executable, "-m", "tests.certificates.plants"],
        cwd=ROOT,
        env=os.environ | {"PYTHONHASHSEED": "7", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(done.stdout) == plants.identities()


UNHASHABLE = {
    "a lock": threading.Lock(),
    "a generator": (k for k in range(3)),
    "an open file": open(__file__, encoding="utf-8"),  # noqa: SIM115
    "a thread's": threading.local(),
}


def ignoring(what, env, observation, info):
    return Estimate(np.array(observation))


@pytest.mark.usefixtures("released")
@pytest.mark.parametrize("what", UNHASHABLE)
def test_a_part_that_cannot_be_hashed_covers_nothing_and_is_named(what):
    plant = replace(BASE, state=functools.partial(ignoring, {"inner": UNHASHABLE[what]}))
    now = stated(plant)
    judged = certificates.judged_by(made(stated(BASE) | now), now)
    one = made({k: v for k, v in now.items() if k != CANNOT})
    with pytest.warns(
        CoverageWarning, match="cannot be hashed .*state: .*inner: TypeError: cannot pickle"
    ):
        filtered = SafetyFilter(Mass(), plant=plant, certificate=one)
    _, info = filtered.reset(seed=0)
    assert info["safety_filter"]["covered_by"] == CoveredBy.CERTIFICATE
    assert judged.outside


def hidden(env, observation, info):
    return eval("GAIN") * np.asarray(observation)


def test_a_function_whose_reads_are_known_at_run_time_alone_cannot_be_hashed():
    (text,) = stated(replace(BASE, state=hidden))[CANNOT]
    assert text.startswith("state: global eval: ")


LOOPED: list = [1.0]
LOOPED.append(LOOPED)


def even(n):
    return n == 0 or odd(n - 1)


def odd(n):
    return n != 0 and even(n - 1)


class Linked:
    def __init__(self, gain):
        self.gain, self.other = gain, self


@pytest.mark.parametrize("loop", [LOOPED, even, odd, Linked(1.0), Linked])
def test_what_refers_to_itself_has_an_identity(loop):
    assert identity.of(loop) == identity.of(loop)


def test_loops_that_differ_are_distinguished():
    assert identity.of(Linked(1.0)) != identity.of(Linked(2.0))
    assert identity.of(even) != identity.of(odd)


def test_an_edit_of_an_own_module_counts_where_it_is_read(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "identity_physics.py").write_text("gain, other = 1.0, 2.0\ndef f(x): return x\n")
    import identity_physics

    text = "import identity_physics as own\ndef read(x): return own.gain * own.f(x)"
    by_name = plants.of_text(text)

    def inside(x):
        from identity_physics import gain

        return gain * x

    def whole(x):
        import identity_physics as physics

        return physics.gain * x

    readers = by_name, inside, whole
    before = [identity.of(one) for one in readers]
    identity_physics.other = 3.0
    after = [identity.of(one) for one in readers]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, True, False]
    identity_physics.gain = 1.5
    assert not set(map(identity.of, readers)) & {*before, *after}
    monkeypatch.delitem(sys.modules, "identity_physics")


def test_lines_and_files_are_no_part_of_a_function():
    moved = plants.of_text("\n" * 30 + plants.TEXT)
    assert identity.of(moved) == identity.of(plants.of_text(plants.TEXT))


@needs("jax")
def test_functions_of_jax_count_with_their_text_and_their_parameters():
    import jax
    import jax.numpy as jnp

    def clear(gain):
        def h(x, t, p):
            return gain * jnp.hypot(x[0] - p[0], x[1] - p[1]) - 0.7

        return h

    one = clear(1.0)
    same = barriers.Function("pillar", 1, one, [1.0, 0.0])
    before = identity.of(same)
    same.jet(np.zeros(4))
    assert identity.of(same) == before
    others = [
        barriers.Function("pillar", 1, one, [1.0, 0.01]),
        barriers.Function("pillar", 2, one, [1.0, 0.0]),
        barriers.Function("pillar", 1, clear(1.1), [1.0, 0.0]),
        barriers.Function("pillar", 1, jax.jit(one), [1.0, 0.0]),
        jnp.arange(3.0), jnp.arange(4.0), jnp.arange(3), jnp.hypot,
    ]  # fmt: skip
    found = [before, *map(identity.of, others)]
    assert len(set(found)) == len(found)


def test_what_a_filter_computes_and_keeps_changes_no_identity():
    for entry in (*plants.ENTRIES.values(), plants.DISCS[0]):
        env = Mass()
        plant = replace(BASE, barriers=[entry])
        before = stated(plant)
        filtered = SafetyFilter(env, plant=plant)
        filtered.reset(seed=0)
        for _ in range(3):
            filtered.step(np.array([1.0, 0.5]))
        now = stated(plant, env)
        assert {k: v for k, v in now.items() if k != "environment.x"} == before


@pytest.mark.parametrize("other", [{"lag": 0.06}, {"room": plants.room().classes[0].cells}])
def test_what_an_environments_constructor_was_given_counts(other):
    one = made(stated(BASE))
    assert certificates.judge(stated(BASE, Mass(**other)), one.plant).outside


def test_what_a_plant_declares_adds_to_its_identity():
    plant = replace(BASE, declared={"load": 1.0})
    one = made(stated(plant))
    for other in (replace(plant, declared={"load": 1.5}), replace(plant, max_age=0.6)):
        assert certificates.judge(stated(other), one.plant).outside


OPTIONS = {
    "program": {"program": "h-cbf-qp"}, "rows": {"rows": "usual"}, "margin": {"margin": 0.3},
    "solver": {"solver": "daqp"}, "on_alarm": {"on_alarm": "brake"}, "alpha1": {"alpha1": 1.0},
    "alpha2": {"alpha2": 2.5}, "alpha_speed": {"alpha_speed": 2.5},
    "guidance": {"guidance": "geodesic"},
    "allow_late_inputs": {"allow_late_inputs": True},
    "options": {"program": "h-cbf-qp", "gamma0": 10.0},
}  # fmt: skip


@pytest.mark.usefixtures("released")
@pytest.mark.parametrize("which", OPTIONS)
def test_another_option_of_the_filter_than_the_certified_ones_is_not_covered(which):
    usual = {"program": "lex-cbf-qp"}
    options = usual | OPTIONS[which]
    one = made(stated(BASE), margins=BASE.uncertainty, family={"kind": "own"} | usual)
    assert covered_by(one, usual) == CoveredBy.NONE
    with pytest.warns(CoverageWarning, match=which):
        assert covered_by(one, options) == CoveredBy.FILTER


def covered_by(certificate, options):
    filtered = SafetyFilter(Mass(), plant=BASE, certificate=certificate, **options)
    return filtered.reset(seed=0)[1]["safety_filter"]["covered_by"]


@pytest.mark.usefixtures("released")
def test_an_environment_that_derives_from_the_packages_is_another_plant():
    from hcbf_gym.envs import RegionsEnv

    class Own(RegionsEnv):
        def step(self, action):
            return super().step(2.0 * action)

    with pytest.warns(CoverageWarning, match="another environment than the package's"):
        filtered = SafetyFilter(Own(scenario="random"))
    report = filtered.reset(seed=0)[1]["safety_filter"]
    assert report["covered_by"] == CoveredBy.PLANT


def test_the_identity_of_a_large_map_takes_less_than_a_tenth_of_a_second():
    plant = replace(BASE, barriers=[plants.room(1500, 1500)])
    begun = time.process_time()
    stated(plant)
    assert time.process_time() - begun < 0.1
