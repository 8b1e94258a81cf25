"""The evaluation and its command line."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import binom

from hcbf_gym import HcbfError, policies, programs, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.batch import rollout_batch
from hcbf_gym.evaluation.comparison import column_names
from hcbf_gym.evaluation.jobs import Runs, key
from hcbf_gym.evaluation.measures import deadlocked
from hcbf_gym.evaluation.rollouts import Case, Job, aggregate, evaluate
from hcbf_gym.evaluation.sentences import SPEED, sentences
from hcbf_gym.evaluation.statistics import upper_bound
from hcbf_gym.programs import FilterStatus

ROOT = Path(__file__).parents[2]
ROM = "HCBF-Regions-v0"
KEYS = {
    "env",
    "scenario",
    "policy",
    "program",
    "seed",
    "min_h",
    "violation_seconds",
    "relaxed_seconds",
    "tracking_rms",
    "final_error",
    "fell",
    "reached",
    "intervention_rms",
    "status_counts",
}


def command(*arguments):
    return subprocess.run(
        [sys.executable, ROOT / "scripts" / "evaluate.py", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )


def test_the_command_leaves_figures_and_a_complete_summary(tmp_path):
    run = command("--env", ROM, "--episodes", 2, "--workers", 1, "--output", tmp_path)
    assert run.returncode == 0, run.stderr
    assert "lex-cbf-qp: Rank 1 held in all episodes (least h " in run.stdout
    relaxed = r"Rank 2 was relaxed for [\d.]+ s and entered for [\d.]+ s an episode \(least h -"
    assert re.search(relaxed, run.stdout)
    assert re.search(r"none \(no filter\): Rank 1 was violated for .* \(least h -", run.stdout)
    assert "[m/s]" in run.stdout  # the speed limit's unit
    assert "≤" not in run.stdout  # two episodes give no bound
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert (summary["environment"], summary["robot"]) == (ROM, "reduced-order model")
    assert "robot" not in summary["settings"]
    assert len(summary["episodes"]) == 4
    assert len(summary["aggregate"]) == 2
    for episode in summary["episodes"]:
        assert set(episode) >= KEYS
        assert sum(episode["status_counts"].values()) == 1000
    for name in ("paths.png", "series.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_episodes_do_not_depend_on_the_number_of_workers():
    cases = [Case(ROM, "random", "pd", "h-cbf-qp"), Case(ROM, "random", "pd", "none")]
    one, two = (
        {
            (case.program, seed): episode
            for case, seed, episode in evaluate(cases, range(3), Runs(workers=workers))
        }
        for workers in (1, 2)
    )
    assert one.keys() == two.keys()
    for which, episode in one.items():
        np.testing.assert_array_equal(episode.position, two[which].position)


def test_no_two_episodes_share_a_saved_result():
    case = Case(ROM, "random", "pd", "h-cbf-qp", {"gamma0": 1.0})
    others = [
        replace(case, **one)
        for one in (
            {"env": "HCBF-A1Regions-v0"}, {"scenario": "paper-experiment"}, {"policy": "pd-ff"},
            {"program": "r-cbf-qp"}, {"options": {"gamma0": 2.0}}, {"v_max": 0.5}, {"steps": 9},
            {"env_options": {"feedback": "rom"}},
        )
    ]  # fmt: skip
    listed = [Job(case), Job(case, seed=1), *map(Job, others)]
    assert len({key("", job) for job in listed}) == len(listed)
    assert key("", Job(replace(case, options={"gamma0": 1.0}))) == key("", Job(case))


def test_a_summary_repeats_what_the_episode_recorded():
    episode = Case(ROM, "paper-simulation", "pd", "r-cbf-qp").run(seed=0)
    summary = episode.summary()
    np.testing.assert_array_equal(summary["min_h"], episode.min_h.min(axis=0))
    assert summary["final_error"] == episode.tracking_error[-1]
    assert summary["status_counts"]["RELAXED"] == (episode.status == FilterStatus.RELAXED).sum()
    assert (episode.position[1:] != episode.position[:-1]).any()
    (row,) = aggregate([Case(ROM, "paper-simulation", "pd", "r-cbf-qp").label() | summary])
    assert row["min_h"] == summary["min_h"]
    assert row["episodes"] == 1


def test_a_summary_counts_steps_in_strict_regions_by_the_truth():
    """The same path, its barriers ranked otherwise: the filter's own statuses say nothing of it."""
    episode = Case(ROM, "paper-simulation", "pd", "none").run(seed=0)
    entered = (episode.min_h[1:] < 0.0).sum(axis=0)
    k = int(entered.argmax())
    assert entered[k] > 0
    alone = np.where(np.arange(len(entered)) == k, 1, 2)
    assert replace(episode, priority=alone).summary()["outside_steps"] == entered[k]
    assert replace(episode, priority=alone + 1).summary()["outside_steps"] == 0


def test_sentences_distinguish_a_relaxed_rank_from_an_entered_one():
    row = {"episodes": 1, "min_h": [0.1, -0.2, 0.3], "share_entered": [0.0, 1.0, 0.0]}
    row |= {"violation_seconds": [0.0, 3.4, 0.0], "relaxed_seconds": {"2": 2.9}}
    conditions = [("wall", 1), ("lawn", 2), (SPEED, 3)]
    assert sentences(row, conditions) == [
        "Rank 1 held in all episodes (least h 0.10 m, wall).",
        "Rank 2 was relaxed for 2.9 s and entered for 3.4 s (least h -0.20 m, lawn).",
        "Rank 3 held (least h 0.30 m/s, speed limit).",
    ]


def test_no_filter_is_no_program():
    with pytest.raises(HcbfError, match="leave the environment without SafetyFilter"):
        programs.make("none")


def test_columns_name_the_policy_where_there_are_several():
    pairs = [("own.py:act", "none"), ("own.py:act", "lex-cbf-qp"), ("pd", "none")]
    rows = [{"policy": policy, "program": program} for policy, program in pairs]
    assert column_names(rows) == [
        "own.py:act\nnone (no filter)",
        "own.py:act\nlex-cbf-qp",
        "pd\nnone (no filter)",
    ]
    assert column_names(rows[:2]) == ["none (no filter)", "lex-cbf-qp"]


def test_standing_with_a_wish_to_move_away_from_the_goal_alone_is_a_deadlock():
    velocity = np.array([[0.01, 0.0], [1.0, 1.0], [0.01, 0.0], [0.01, 0.0]])
    u_nominal = np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0]])
    found = deadlocked(velocity, u_nominal, np.array([2.0, 2.0, 2.0, 0.2]), 0.25)
    assert found.tolist() == [True, False, False, False]


@pytest.mark.parametrize("program", ["none", "lex-cbf-qp"])
def test_every_episode_of_a_batch_is_the_one_that_runs_alone(program):
    env = gym.make_vec("HCBF-Regions-v0", num_envs=4, scenario="random", autoreset_mode="Disabled")
    policy = policies.PDTracker.for_env(env)
    if program != "none":
        env = wrappers.VectorSafetyFilter(env, program)
    batch = rollout_batch(env, policy, seed=3)
    assert len(set(batch.steps)) > 1  # they end at different times
    for k in range(4):
        episode = Case("HCBF-Regions-v0", "random", "pd", program).run(seed=3 + k)
        summary, steps = episode.summary(), len(episode.reward)
        assert batch.steps[k] == steps
        np.testing.assert_allclose(batch.position[: steps + 1, k], episode.position, atol=1e-9)
        np.testing.assert_allclose(batch.min_h[k], summary["min_h"], atol=1e-9)
        np.testing.assert_allclose(batch.reward[:, k].sum(), summary["return"], atol=1e-9)
        np.testing.assert_allclose(batch.seconds_inside[k], summary["violation_seconds"], atol=1e-9)
        if_filtered = summary["intervention_rms"] if program != "none" else 0.0
        np.testing.assert_allclose(batch.intervention_rms[k], if_filtered, atol=1e-9)
        assert batch.terminated[k] == summary["reached"]


@pytest.mark.parametrize(("entered", "episodes"), [(0, 1), (0, 688), (3, 40), (5, 16450), (39, 40)])
def test_at_the_bound_so_few_entries_are_as_rare_as_the_doubt(entered, episodes):
    bound = upper_bound(entered, episodes, 0.99)
    assert binom.cdf(entered, episodes, bound) == pytest.approx(0.01, rel=1e-6)


def test_the_bound_covers_the_true_chance_with_its_confidence():
    rng = np.random.default_rng(0)
    chance, episodes = 0.02, 200
    counts = rng.binomial(episodes, chance, 4000)
    covered = np.mean([upper_bound(int(k), episodes, 0.95) >= chance for k in counts])
    assert covered >= 0.94


def test_nothing_is_bounded_where_all_enter():
    assert upper_bound(7, 7) == 1.0


@pytest.mark.parametrize(
    "refused",
    [
        lambda: upper_bound(0, 0),
        lambda: upper_bound(-1, 5),
        lambda: upper_bound(6, 5),
        lambda: upper_bound(True, 5),
        lambda: upper_bound(0.0, 5),  # type: ignore[arg-type]
        lambda: upper_bound(0, 5, 1.0),
        lambda: upper_bound(0, 5, float("nan")),
    ],
)
def test_invalid_counts_and_shares_are_refused(refused):
    with pytest.raises(InvalidInputError):
        refused()
