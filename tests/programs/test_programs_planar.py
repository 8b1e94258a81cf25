"""The compiled polygons against rational arithmetic, and the batch against the single programs."""

import contextlib
import itertools
from dataclasses import asdict

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
from benchmarks.judges.judge import Judge
from benchmarks.suites import verify_programs
from hcbf_gym import programs
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Box
from hcbf_gym.programs import CbfRows, Plan, plans

NAMES = programs.names()


@pytest.mark.parametrize("name", NAMES)
def test_every_form_finds_the_exact_solution(name):
    for group in range(3):
        for tally in verify_programs.verify_group(name, [1, group], size=5).values():
            assert tally.problems == 5
            assert tally.wrong == tally.backups == 0


@pytest.mark.parametrize("name", NAMES)
def test_a_state_is_filtered_alike_whatever_its_company(name):
    rng = np.random.default_rng(3)
    rows = verify_programs.random_rows(rng, 50, 5)
    u_nominal = rng.normal(0.0, 4.0, (50, 2))
    together = programs.make_batch(name)(u_nominal, rows)
    single = programs.make(name)
    for i in range(50):
        alone = single(u_nominal[i], CbfRows(*(field[i] for field in rows if field is not None)))
        for one, many in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, many[i])


def test_the_batch_is_planar():
    with pytest.raises(InvalidInputError, match="expected 2"):
        programs.make_batch("h-cbf-qp", input_set=Box.symmetric(5.0, n_u=3))
    rows = CbfRows(np.zeros((3, 1, 2)), *np.zeros((2, 3, 1)), np.ones((3, 1), dtype=int))
    with pytest.raises(InvalidInputError, match=r"rows\.b"):
        programs.make_batch("h-cbf-qp")(np.zeros((2, 2)), rows)


def test_an_empty_batch_is_allowed():
    rows = CbfRows(np.zeros((0, 2, 2)), *np.zeros((2, 0, 2)), np.ones((0, 2), dtype=int))
    assert programs.make_batch("lex-cbf-qp")(np.zeros((0, 2)), rows).u.shape == (0, 2)


@pytest.mark.parametrize("lambda_u", [0.0, 1.0])
@pytest.mark.parametrize("name", NAMES)
def test_rows_of_one_level_may_differ_in_steepness_by_any_factor(name, lambda_u):
    options = {"lambda_u": lambda_u} if "lambda_u" in programs.options(name) else {}
    rng = np.random.default_rng(5)
    for flatness in (1e-4, 1e-6, 1e-9):
        a = rng.normal(0.0, 1.0, (8, 5, 2))
        a[:, 3:] *= flatness
        b = np.linalg.norm(a, axis=-1) * rng.uniform(2.0, 6.0, (8, 5))
        priority = np.where(rng.random((8, 1)) < 0.5, 1, [1, 2, 2, 2, 2])
        rows = CbfRows(a, b, np.zeros((8, 5)), priority, np.zeros((8, 5)))
        u_nominal = rng.normal(0.0, 4.0, (8, 2))
        single = programs.make(name, **options)
        batch = programs.make_batch(name, **options)(u_nominal, rows)
        for i in range(8):
            row = CbfRows(*(field[i] for field in rows if field is not None))
            judge = Judge.of(single.input_set, u_nominal[i], row, single)
            wanted = np.array(judge.solve(name), dtype=float)
            np.testing.assert_allclose(single(u_nominal[i], row).u, wanted, atol=1e-8)
            np.testing.assert_allclose(batch.u[i], wanted, atol=1e-8)


def test_a_steep_row_that_pays_next_to_nothing_holds_back_a_flat_one():
    # at the exact input the last row is missed by 3e-10; where it is met, u is 1.4e-3 away
    a = np.array(
        [
            [-4.8873597831976683e-05, 1.7364811107275848e-04],
            [2.3227096218702284e-06, 4.1720428636774012e-06],
            [-1.8582371707051304e-01, -4.7164560228609270e-01],
        ]
    )
    b = np.array([-1.3858869883575072e-04, 2.0365601512877568e-05, 6.6065979564072919e-01])
    rows = CbfRows(a, b, np.zeros(3), np.array([1, 2, 2]))
    u_nominal, program = np.array([4.077634613017361, 0.9765663756775531]), programs.make("cbf-qp")
    judge = Judge.of(program.input_set, u_nominal, rows, program)
    wanted = np.array(judge.solve("cbf-qp"), dtype=float)
    np.testing.assert_allclose(program(u_nominal, rows).u, wanted, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("lex-cbf-qp", 7),  # both solvers call one of it infeasible, which by construction none is
        ("eh-cbf-qp", 189),  # one has a row parallel to a strict one beside one 1e9 times as flat
    ],
)
def test_the_hardest_groups_leave_an_answer_beyond_the_plane(name, group):
    (tally,) = verify_programs.verify_group(name, [0, group], ("7 inputs",)).values()
    assert tally.problems == 100
    assert tally.wrong == tally.backups == 0


def test_a_batch_keeps_its_states_weights_beside_a_level_of_unlike_steepness():
    # two strict rows that cannot both be met, one of them flat, and a relaxed one with a weight
    a = np.tile([[1.0, 0.0], [0.0, 1e-6], [0.0, 1.0]], (3, 1, 1))
    b = np.tile([9.0, -6e-6, 3.0], (3, 1))
    rows = CbfRows(a, b, np.full((3, 3), -1.0), np.tile([1, 1, 2], (3, 1)))
    gamma0, delta_gamma = np.array([[0.0], [1.0], [4.0]]), np.array([[0.0], [1.0], [2.0]])
    batch = programs.make_batch("r-cbf-qp", gamma0=gamma0, delta_gamma=delta_gamma)
    result = batch(np.zeros((3, 2)), rows)
    weight = (gamma0 * (1.0 + delta_gamma)).ravel()
    # min y² + w (3 − y)², as far right as U allows
    np.testing.assert_allclose(result.u[:, 0], 5.0)
    np.testing.assert_allclose(result.u[:, 1], 3.0 * weight / (1.0 + weight), atol=1e-9)


def test_weights_of_other_states_are_refused_by_every_form():
    rows = CbfRows(np.zeros((3, 1, 2)), *np.ones((2, 3, 1)), np.ones((3, 1), dtype=int))
    for options in ({"delta_gamma": np.array([[1.3]])}, {"gamma0": np.ones((2, 4))}):
        with pytest.raises(InvalidInputError, match="gamma0, delta_gamma"):
            programs.make_batch("r-cbf-qp", **options)(np.zeros((3, 2)), rows)
    several = {"gamma0": np.ones((3, 2))}
    for further in ({}, {"solver": "daqp"}):
        with pytest.raises(InvalidInputError, match="gamma0, delta_gamma"):
            programs.make("r-cbf-qp", **several, **further)
    assert programs.make_batch("r-cbf-qp", **several)(np.zeros((3, 2)), rows).u.shape == (3, 2)


@pytest.mark.parametrize("name", NAMES)
def test_the_input_is_in_the_set_even_where_squares_overflow(name):
    rng = np.random.default_rng(9)

    def numbers(*shape):
        return rng.normal(0.0, 1.0, shape) * 10.0 ** rng.uniform(-300.0, 300.0, shape)

    rows = CbfRows(
        numbers(3000, 4, 2), numbers(3000, 4), numbers(3000, 4), np.tile([1, 2, 3, 2], (3000, 1))
    )
    rows = rows._replace(alpha2_psi=numbers(3000, 4))
    result = programs.make_batch(name)(numbers(3000, 2), rows)
    assert (np.abs(result.u) <= 5.0).all()


def test_every_row_may_have_its_own_priority():
    m = 100  # more than the ranks that a filter has
    rng = np.random.default_rng(8)
    rows = CbfRows(
        rng.normal(0.0, 1.0, (m, 2)),
        rng.normal(0.0, 3.0, m),
        *np.zeros((1, m)),
        rng.permutation(m) + 1,
        np.zeros(m),
    )
    alone = programs.make("lex-cbf-qp", solver="daqp")(np.zeros(2), rows)
    np.testing.assert_allclose(programs.make("lex-cbf-qp")(np.zeros(2), rows).u, alone.u, atol=1e-6)


# ------------------------------------------------------------------ plans


def every_plan():
    fields = (plans.STRICT, plans.LOWER, plans.ORDER, plans.LOCK)
    for choices in itertools.product(*fields):
        with contextlib.suppress(InvalidInputError):
            yield Plan(*choices)


@pytest.mark.parametrize("plan", list(every_plan()), ids=lambda plan: "-".join(vars(plan).values()))
def test_both_interpreters_read_every_plan_alike(plan):
    rng = np.random.default_rng(6)
    rows = CbfRows(
        rng.normal(0.0, 1.0, (40, 5, 2)),
        rng.normal(0.0, 3.0, (40, 5)),
        rng.normal(0.0, 1.0, (40, 5)),
        np.tile([1, 2, 2, 3, 4], (40, 1)),
        rng.normal(0.0, 2.0, (40, 5)),
    )
    u_nominal = rng.normal(0.0, 4.0, (40, 2))
    given = {"weights": [None, 3.0, None, 20.0], "gamma0": [4.0, 20.0], "epsilon": "known"}
    options = {key: value for key, value in given.items() if key in plan.options}
    batch = programs.make_batch(plan, **options)(u_nominal, rows)
    general = programs.make(plan, solver="daqp", **options)
    for i in range(40):
        alone = general(u_nominal[i], CbfRows(*(field[i] for field in rows)))
        np.testing.assert_allclose(batch.u[i], alone.u, atol=1e-6)
        np.testing.assert_allclose(batch.delta[i], alone.delta, atol=1e-5)
        assert batch.status[i] == alone.status


def test_a_plan_that_makes_no_sense_is_refused():
    for choices in (
        {"strict": "none"},
        {"strict": "first", "lower": "drawn", "order": "by level"},
        {"strict": "first", "lower": "relaxed", "lock": "bound"},
        {"strict": "all", "order": "by level", "lock": "pin"},
    ):
        with pytest.raises(InvalidInputError, match="plan"):
            Plan(**choices)
    with pytest.raises(InvalidInputError, match="plan"):
        programs.make({"strict": "all", "levels": 3})
    with pytest.raises(InvalidInputError, match="taken"):
        programs.register("lex-cbf-qp", Plan("all"))
    for name in (None, 1, "", ["mine"]):
        with pytest.raises(InvalidInputError, match="text"):
            programs.register(name, Plan("all"))


def test_a_plan_of_your_own_filters_an_environment_by_name_and_as_it_is(monkeypatch):
    monkeypatch.setattr(plans, "_PLANS", plans._PLANS.copy())
    own = Plan(strict="first", lower="relaxed", order="by level", lock="bound")
    programs.register("my-qp", own)
    assert "my-qp" in programs.names()
    rows = CbfRows(np.eye(2)[None], *np.ones((2, 1, 2)), np.array([[1, 2]]))
    assert programs.make_batch("my-qp", gamma0=3.0)(np.zeros((1, 2)), rows).u[0, 0] == 1.0
    envs = [
        hcbf_gym.wrappers.SafetyFilter(gym.make("HCBF-Regions-v0"), program, solver=solver)
        for program, solver in (("my-qp", None), (own, None), (asdict(own), None), (own, "daqp"))
    ]
    for env in envs:
        env.reset(seed=3)
    for _ in range(50):
        infos = [env.step(np.array([5.0, 1.0]))[-1]["safety_filter"] for env in envs]
        np.testing.assert_array_equal(infos[0]["u_safe"], infos[1]["u_safe"])
        np.testing.assert_array_equal(infos[0]["u_safe"], infos[2]["u_safe"])
