"""The examples of the documentation run as printed, only shorter."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.mark.physics
def test_an_agent_learns_under_the_filter_and_walks_the_a1(capsys):
    source = (EXAMPLES / "agent_in_20_lines.py").read_text(encoding="utf-8")
    short = source.replace("num_envs=256", "num_envs=4").replace("1_000_000", "256")
    short = short.replace("batch_size=2048", "batch_size=256")
    assert short.count("256") == 2
    names = {}
    exec(compile(short, "agent_in_20_lines.py", "exec"), names)
    scenario = names["a1"].unwrapped.scenario
    strict = [barrier.priority == 1 for barrier in scenario.barriers]
    assert (names["least"][: len(strict)][strict] >= 0.0).all()
    assert np.isfinite(names["observation"]).all()
    assert "least h" in capsys.readouterr().out
