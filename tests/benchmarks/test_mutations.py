"""Malformed inputs are refused with the package's errors, or make sense."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.suites import mutations
from hcbf_gym import scenarios
from hcbf_gym.envs.disturbances import disturbance_from_dict
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.robots import a1

RECORDS = {
    "scenario": (scenarios.from_dict, scenarios.make("paper-experiment").to_dict()),
    "randomization": (Randomization.from_dict, mutations.RANDOMIZATION),
    "random pushes": (disturbance_from_dict, mutations.DISTURBANCES[0]),
    "scheduled pushes": (disturbance_from_dict, mutations.DISTURBANCES[1]),
}


@settings(deadline=None, max_examples=200)
@given(st.sampled_from(sorted(RECORDS)), st.integers(0, 2**32 - 1))
def test_a_mutated_record_is_read_or_refused_with_the_package_s_error(name, seed):
    read, data = RECORDS[name]
    changed = mutations.mutated(data, np.random.default_rng(seed))
    assert repr(changed) != repr(data) or name == "scenario"  # None may be replaced by None
    outcome, message = mutations.judge(lambda _: read(changed), np.random.default_rng(0))
    assert outcome in ("refused", "accepted"), message


@pytest.mark.parametrize("kind", sorted(mutations.CASES))
def test_malformed_inputs_are_refused_or_make_sense(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where MuJoCo leaves a log of its warnings
    seen = set()
    for seed in range(12):
        outcome, message = mutations.judge(mutations.CASES[kind], mutations.generator(kind, seed))
        assert outcome not in mutations.WRONG, f"seed {seed}: {message}"
        seen.add(outcome)
    assert seen == {"refused", "accepted"}


def test_a_mutated_robot_file_differs():
    text = a1.XML_FILE.read_text(encoding="utf-8")
    files = {mutations.mutated_xml(text, np.random.default_rng(seed)) for seed in range(20)}
    assert text not in files


def test_refusals_raw_errors_and_hangs_are_distinguished(monkeypatch):
    def refuse(_rng):
        raise InvalidInputError("got, expected")

    def break_down(_rng):
        raise KeyError("no such key")

    def hang(_rng):
        while True:
            pass

    def diverge(_rng):
        raise mutations.Nonsense("nan")

    monkeypatch.setattr(mutations, "SECONDS", 0.05)
    cases = (refuse, break_down, hang, diverge, lambda _: None)
    seen = [mutations.judge(case, np.random.default_rng(0))[0] for case in cases]
    assert seen == ["refused", "raw error", "hang", "nonsense", "accepted"]
