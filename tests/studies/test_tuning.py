import json
import math

import hypothesis.strategies as st
import numpy as np
import optuna
import pytest
from hypothesis import given, settings
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

from hcbf_gym import programs
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.evaluation.rollouts import Case
from hcbf_gym.programs import CbfRows
from hcbf_lab.tuning import Cost, Normal, Problem, TuningStudy, command, simulate

optuna.logging.set_verbosity(optuna.logging.WARNING)

PAIRS = np.array([[1.0, 1.3], [3.0, 0.0], [0.05, 2.5], [5.0, 1.3]])


def costs(problem, pairs):
    found = dict(problem.costs(*pairs.T))
    return np.array([found[k] for k in range(len(pairs))])


@pytest.fixture(scope="module")
def problem():
    return Problem()


def test_the_cost_of_constant_error_and_relaxation_is_known_in_closed_form():
    n, error, delta = 50, 0.2, 3.0
    cost = Cost(w_i=4.0, w_f=100.0, w_delta=0.5)
    expected = 2.0 * (n - 1) * error + 10.0 * error + 0.5 * n * delta
    got = cost(np.full(n + 1, error), np.full(n, delta))
    assert math.isclose(got, expected, rel_tol=1e-12)


def test_the_start_costs_nothing_and_the_goal_counts_by_its_own_weight():
    error, nothing = np.zeros(11), np.zeros(10)
    error[0] = 7.0
    assert Cost()(error, nothing) == 0.0
    error[-1] = 1.0
    assert math.isclose(Cost()(error, nothing), math.sqrt(1000.0))


@pytest.mark.parametrize("program", ["r-cbf-qp", "h-cbf-qp", "ih-cbf-qp", "eh-cbf-qp"])
def test_a_batch_costs_what_its_pairs_cost_one_at_a_time(program):
    problem = Problem(program=program)
    batch = costs(problem, PAIRS)
    for (gamma0, delta_gamma), cost in zip(PAIRS[:2], batch, strict=False):
        episode = problem.case(gamma0, delta_gamma).run(0)
        assert math.isclose(problem.cost_of(episode), cost, rel_tol=1e-6)


def test_no_bit_of_a_cost_depends_on_its_batch(problem):
    whole = costs(problem, PAIRS)
    for k in range(len(PAIRS)):
        np.testing.assert_array_equal(costs(problem, PAIRS[k : k + 1]), whole[k : k + 1])


def test_episodes_that_end_early_keep_their_final_error_and_cost_nothing_more():
    run = simulate("random", "h-cbf-qp", *PAIRS.T, seed=3)
    case = Case("HCBF-Regions-v0", "random", "pd", "h-cbf-qp", {"gamma0": 1.0, "delta_gamma": 1.3})
    episode = case.run(3)
    steps = len(episode.tracking_error)
    assert math.isclose(run.tracking_error[-1, 0], episode.tracking_error[-1], abs_tol=1e-6)
    np.testing.assert_allclose(run.min_h[0], episode.min_h.min(axis=0), atol=1e-6)
    assert not run.tracking_error[steps:-1, 0].any()
    assert not run.relaxation[steps - 1 :, 0].any()


@given(number=st.integers(0, 10_000), seed=st.integers(0, 100))
@settings(max_examples=50, deadline=None)
def test_a_draw_is_decided_by_its_number_and_never_negative(number, seed):
    normal = Normal(mean=(0.2, -0.5))
    draw = normal.draw(seed, number)
    assert draw == normal.draw(seed, number)
    assert draw.gamma0 >= 0.0
    assert draw.delta_gamma >= 0.0


def test_accepted_draws_have_the_moments_of_the_truncated_normal():
    normal = Normal(mean=(3.0, 1.5), covariance=((1.0, 0.5), (0.5, 1.0)))
    draws = np.array([normal.draw(0, k) for k in range(4000)])
    rng = np.random.default_rng(1)
    raw = rng.multivariate_normal(normal.mean, normal.covariance, 200_000)
    kept = raw[(raw >= 0.0).all(axis=1)]
    np.testing.assert_allclose(draws[:, :2].mean(axis=0), kept.mean(axis=0), atol=0.06)
    np.testing.assert_allclose(np.cov(draws[:, :2].T), np.cov(kept.T), atol=0.08)
    rejected = draws[:, 2].sum() / (draws[:, 2].sum() + len(draws))
    assert abs(rejected - (1.0 - len(kept) / len(raw))) < 0.015


def journal(path):
    return JournalStorage(JournalFileBackend(str(path)))


@pytest.mark.parametrize("sampler", ["normal", "tpe", "cmaes"])
def test_a_killed_study_continues_with_the_samples_that_were_to_come(
    problem, sampler, tmp_path, monkeypatch
):
    storage = journal(tmp_path / "study.log")
    unbroken = TuningStudy(problem, Normal(), sampler, 1).run(35)
    whole, calls = Problem.costs, []

    def costs_until_the_power_fails(self, *args, **options):
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return whole(self, *args, **options)

    monkeypatch.setattr("hcbf_lab.tuning.study.DRAWS", 10)
    monkeypatch.setattr(Problem, "costs", costs_until_the_power_fails)
    with pytest.raises(KeyboardInterrupt):
        TuningStudy(problem, Normal(), sampler, 1, storage).run(35)
    monkeypatch.setattr(Problem, "costs", whole)
    resumed = TuningStudy(problem, Normal(), sampler, 1, journal(tmp_path / "study.log")).run(35)
    alike = 20 if sampler == "cmaes" else 35  # CMA-ES draws by the numbers of trials, lost ones too
    assert len(resumed.cost) == 35
    for got, expected in zip(resumed, unbroken, strict=True):
        np.testing.assert_array_equal(got[:alike], expected[:alike])


def test_a_log_that_ends_within_a_line_can_be_continued(tmp_path):
    log = tmp_path / "study.log"
    for samples in (2, 3, 4):
        command.main(command.Args(samples=samples, output=tmp_path))
        log.write_bytes(log.read_bytes()[:-20])
    tuned = json.loads((tmp_path / "tuning.json").read_text(encoding="utf-8"))
    assert len(tuned["samplers"]["normal"]["cost"]) == 4


def test_a_fall_costs_infinity_and_is_kept_as_such(problem, tmp_path, monkeypatch):
    def costs(self, gamma0, delta_gamma, runs):
        return enumerate(np.where(np.array(gamma0) > 3.0, np.inf, np.array(gamma0)))

    monkeypatch.setattr(Problem, "costs", costs)
    for _ in range(2):  # written, then read
        storage = journal(tmp_path / "study.log")
        samples = TuningStudy(problem, Normal(), "normal", 0, storage).run(12)
        np.testing.assert_array_equal(np.isinf(samples.cost), samples.gamma0 > 3.0)
        assert np.isinf(samples.cost).any()
        assert samples.cost[samples.best] == samples.gamma0.min()


def test_a_storage_with_another_study_is_refused_and_left_alone(problem, tmp_path):
    path = tmp_path / "study.log"
    TuningStudy(problem, Normal(), "normal", 0, journal(path)).run(2)
    before = path.read_bytes()
    for other in (
        TuningStudy(problem, Normal(), "normal", 1, journal(path)),
        TuningStudy(problem, Normal(mean=(2.0, 1.5)), "normal", 0, journal(path)),
        TuningStudy(Problem(cost=Cost(w_f=1.0)), Normal(), "normal", 0, journal(path)),
    ):
        with pytest.raises(InvalidInputError, match="other settings"):
            other.run(2)
    kept = [json.loads(line) for line in path.read_bytes().splitlines()]
    assert kept[: before.count(b"\n")] == [json.loads(line) for line in before.splitlines()]


def _filter_three_states(gamma0):
    rows = CbfRows(
        np.ones((3, 2, 2)), np.ones((3, 2)), np.ones((3, 2)), np.array([[1, 2]] * 3), None
    )
    return programs.make_batch("h-cbf-qp", gamma0=gamma0)(np.zeros((3, 2)), rows)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Normal(covariance=((1.0, 2.0), (2.0, 1.0))), "positive semidefinite"),
        (lambda: Normal(covariance=((1.0, 0.5), (0.0, 1.0))), "symmetric"),
        (lambda: Normal(mean=(1.0, np.nan)), "finite"),
        (lambda: Normal((-1.0, 1.0), ((0.0, 0.0), (0.0, 0.0))).draw(0, 0), "were negative"),
        (lambda: Cost(w_i=-1.0), "w_i"),
        (lambda: Problem(program="lex-cbf-qp"), "takes gamma0"),
        (lambda: Problem(env="HCBF-Moon-v0"), "unknown environment"),
        (lambda: programs.make_batch("h-cbf-qp", gamma0=np.array([[-1.0]])), "gamma0"),
        (lambda: programs.make_batch("h-cbf-qp", delta_gamma=np.array([[np.nan]])), "delta_gamma"),
        (lambda: _filter_three_states(np.ones((2, 1))), "weights of 2 states"),
        (lambda: Problem().costs([], []), "N >= 1"),
        (lambda: Problem().costs([-1.0], [0.0]), "gamma0"),
        (lambda: Problem().costs([1.0], [-0.1]), "delta_gamma"),
        (lambda: Problem().costs([1.0], [np.nan]), "delta_gamma"),
        (lambda: TuningStudy(Problem(), Normal()).run(0), "at least 1"),
        (lambda: TuningStudy(Problem(), Normal(), "sobol"), "unknown sampler"),
    ],
)
def test_bad_input_is_refused_with_what_was_expected(make, message):
    with pytest.raises((InvalidInputError, UnknownNameError), match=message):
        make()
