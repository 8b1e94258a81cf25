import copy
import pickle

import numpy as np
import pytest
import scipy.optimize

from hcbf_gym import _core, programs
from hcbf_gym.errors import InvalidInputError, SolverError, UnknownNameError
from hcbf_gym.models import Ball, Box
from hcbf_gym.programs import CbfRows, FilterStatus, qp

NAMES = programs.names()
BOX = Box.symmetric(5.0)
COMMON_SOLVERS = {"daqp", "clarabel", "highs", "osqp", "piqp", "proxqp", "quadprog"}


def rows_of(a, b, priority, h=None, alpha2_psi=None):
    a = np.array(a, dtype=float).reshape(len(b), -1)
    b = np.array(b, dtype=float)
    h = np.ones(b.size) if h is None else np.array(h, dtype=float)
    psi = np.zeros(b.size) if alpha2_psi is None else np.array(alpha2_psi, dtype=float)
    return CbfRows(a, b, h, np.array(priority, dtype=np.int64), psi)


# ux >= 2 is strict, -ux >= 1 is relaxed: the smallest conflict there is
CONFLICT = rows_of([[1.0, 0.0], [-1.0, 0.0]], [2.0, 1.0], [1, 2])
# ux >= 7 cannot be met where |ux| <= 5
HOPELESS = rows_of([[1.0, 0.0], [-1.0, 0.0]], [7.0, 1.0], [1, 2])


@pytest.mark.parametrize("name", NAMES)
def test_an_input_that_meets_every_row_is_left_alone(name):
    rows = rows_of([[1.0, 0.0], [0.0, 2.0]], [-3.0, -4.0], [1, 2])
    result = programs.make(name)(np.array([1.0, -1.5]), rows)
    np.testing.assert_array_equal(result.u, [1.0, -1.5])
    assert result.status is FilterStatus.NOMINAL
    assert not result.slack.any()


@pytest.mark.parametrize("name", NAMES)
def test_a_nominal_input_outside_the_set_comes_back_inside(name):
    for input_set in (BOX, Ball(5.0)):
        rows = rows_of([[1.0, 0.0]], [-30.0], [1])
        result = programs.make(name, input_set=input_set)(np.array([40.0, -30.0]), rows)
        np.testing.assert_allclose(result.u, input_set.project([40.0, -30.0]), atol=1e-9)
        assert result.status is FilterStatus.SAFE


@pytest.mark.parametrize("name", NAMES)
def test_without_rows_only_the_input_set_counts(name):
    nothing = CbfRows(*(field[:0] for field in CONFLICT if field is not None))
    result = programs.make(name)(np.array([9.0, 1.0]), nothing)
    np.testing.assert_allclose(result.u, [5.0, 1.0], atol=1e-9)
    assert result.slack.shape == (0,)


@pytest.mark.parametrize("name", NAMES)
def test_the_status_is_that_of_the_row_that_pays(name):
    program = programs.make(name)
    safe = rows_of([[1.0, 0.0]], [2.0], [1])
    assert program(np.zeros(2), safe).status is FilterStatus.SAFE
    status = program(np.zeros(2), CONFLICT).status
    assert status is (FilterStatus.VIOLATED if name == "cbf-qp" else FilterStatus.RELAXED)
    assert program(np.zeros(2), HOPELESS).status is FilterStatus.VIOLATED


@pytest.mark.parametrize("name", sorted({*NAMES} - {"cbf-qp"}))  # which treats all rows alike
def test_strict_rows_hold_whatever_the_others_ask(name):
    result = programs.make(name)(np.zeros(2), CONFLICT)
    assert result.u[0] == pytest.approx(2.0, abs=1e-9)
    assert result.slack[0] == 0.0
    assert result.slack[1] == pytest.approx(3.0, abs=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_a_strict_row_that_cannot_be_met_is_violated_least(name):
    result = programs.make(name)(np.array([1.0, 2.0]), rows_of([[1.0, 0.0]], [7.0], [1]))
    np.testing.assert_allclose(result.u, [5.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(result.slack, [2.0], atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_a_zero_row_is_a_constant(name):
    with_zero = rows_of([[0.0, 0.0], [1.0, 0.0]], [3.0, 2.0], [1, 1])
    without = rows_of([[1.0, 0.0]], [2.0], [1])
    program = programs.make(name)
    result = program(np.zeros(2), with_zero)
    np.testing.assert_allclose(result.u, program(np.zeros(2), without).u, atol=1e-9)
    np.testing.assert_allclose(result.slack, [3.0, 0.0])


@pytest.mark.parametrize(("n_u", "solver"), [(2, None), (2, "daqp"), (3, None)])
def test_a_program_that_has_answered_is_pickled_and_copied(n_u, solver):
    program = programs.make("ih-cbf-qp", input_set=Box.symmetric(2.0, n_u=n_u), solver=solver)
    rows = rows_of(np.eye(n_u)[:2], [3.0, 1.0], [1, 2])
    expected = program(np.zeros(n_u), rows)
    for twin in (pickle.loads(pickle.dumps(program)), copy.deepcopy(program)):
        for one, other in zip(twin(np.zeros(n_u), rows), expected, strict=True):
            np.testing.assert_array_equal(one, other)


# ------------------------------------------------------------------ bad input


@pytest.mark.parametrize("name", NAMES)
def test_unknown_options_and_solvers_are_refused_with_the_choices(name):
    with pytest.raises(InvalidInputError, match="expected among"):
        programs.make(name, gamma=1.0)
    with pytest.raises(UnknownNameError, match="daqp"):
        programs.make(name, solver="oracle")


def test_an_unknown_program_is_refused_with_the_choices():
    for make in (programs.make, programs.make_batch, programs.options):
        with pytest.raises(UnknownNameError, match="lex-cbf-qp"):
            make("hope")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("h-cbf-qp", {"gamma0": -1.0}),
        ("h-cbf-qp", {"gamma0": []}),
        ("h-cbf-qp", {"delta_gamma": np.nan}),
        ("h-cbf-qp", {"lambda_u": -1.0}),
        ("r-cbf-qp", {"epsilon": "some"}),
        ("lex-cbf-qp", {"weights": [1.0]}),
        ("lex-cbf-qp", {"weights": [None, -2.0]}),
        ("lex-cbf-qp", {"weights": "high"}),
    ],
)
def test_senseless_weights_are_refused(name, options):
    with pytest.raises(InvalidInputError):
        programs.make(name, **options)


@pytest.mark.parametrize(
    "broken",
    [
        {"a": np.array([[np.nan, 0.0], [-1.0, 0.0]])},
        {"b": np.array([np.inf, 0.0])},
        {"h": np.array([np.nan, 0.0])},
        {"alpha2_psi": np.array([np.nan, 0.0])},
        {"a": np.zeros((2, 3))},
        {"b": np.zeros(3)},
        {"h": np.zeros(1)},
        {"priority": np.array([0, 1])},
        {"priority": np.array([1, 3])},
        {"priority": np.array([2, 2])},
        {"priority": np.array([1.0, 2.0])},
    ],
)
def test_malformed_rows_are_refused(broken):
    rows = CONFLICT._replace(**broken)
    with pytest.raises(InvalidInputError, match=r"rows\."):
        programs.make("lex-cbf-qp")(np.zeros(2), rows)
    batch = CbfRows(*(np.asarray(field)[None] for field in rows))
    with pytest.raises(InvalidInputError, match=r"rows\."):
        programs.make_batch("lex-cbf-qp")(np.zeros((1, 2)), batch)


@pytest.mark.parametrize("u", [[np.nan, 0.0], [1.0], [[1.0, 2.0]], ["fast", "slow"]])
def test_malformed_inputs_are_refused(u):
    with pytest.raises(InvalidInputError, match="u_nominal"):
        programs.make("h-cbf-qp")(u, CONFLICT)


def test_a_known_offset_needs_rows_that_carry_it():
    with pytest.raises(InvalidInputError, match="alpha2_psi"):
        programs.make("r-cbf-qp", epsilon="known")(np.zeros(2), CONFLICT._replace(alpha2_psi=None))


# ------------------------------------------------------------------ solvers by name


def test_a_point_that_misses_a_row_is_not_accepted(monkeypatch):
    problem = np.zeros(2), np.eye(2), np.ones(2)
    np.testing.assert_allclose(qp.solve("daqp", *problem), [1.0, 1.0])
    for missing in (np.zeros(2), np.full(2, np.nan)):
        monkeypatch.setattr(qp, "_solve_by_daqp", lambda *_, x=missing: x)
        assert qp.solve("daqp", *problem) is None


@pytest.mark.parametrize("solver", ["daqp", "clarabel"])
def test_an_infeasible_problem_has_no_point(solver):
    problem = np.zeros(2), np.array([[1.0, 0.0], [-1.0, 0.0]]), np.ones(2)
    asked = qp.Solver(solver)
    assert asked.project(*problem, nonempty=False) is None
    assert asked.fallbacks == 0
    with pytest.raises(SolverError):
        asked.project(*problem, nonempty=True)


@pytest.mark.parametrize("name", NAMES)
def test_the_core_answers_where_a_solver_fails_and_is_counted(name, monkeypatch):
    program = programs.make(name, solver="daqp")
    expected = program(np.zeros(2), CONFLICT)
    assert expected.fallbacks == 0
    monkeypatch.setattr(qp, "_solve_by_daqp", lambda *_: None)
    result = program(np.zeros(2), CONFLICT)
    np.testing.assert_allclose(result.u, expected.u, atol=1e-7)
    assert result.status is expected.status
    assert result.fallbacks > 0


@pytest.mark.parametrize("name", NAMES)
def test_where_nothing_answers_the_robot_brakes_with_that_status(name, monkeypatch):
    monkeypatch.setattr(qp, "_solve_by_daqp", lambda *_: None)
    monkeypatch.setattr(_core, "nearest_point", lambda *_: None)
    result = programs.make(name, solver="daqp")(np.array([-1.0, 1.0]), CONFLICT)
    np.testing.assert_array_equal(result.u, [0.0, 0.0])
    assert result.status is FilterStatus.BACKUP


@pytest.mark.parametrize("name", NAMES)
def test_the_common_solvers_that_are_installed_find_the_same_input(name):
    rows = rows_of(
        [[1.0, 0.2], [-0.8, 0.6], [0.1, -1.0]], [2.0, 1.0, 3.0], [1, 2, 3], h=[1.0, -0.5, -0.1]
    )
    expected = programs.make(name)(np.array([-1.0, 2.0]), rows)
    for solver in set(qp.solver_names()) & COMMON_SOLVERS:
        result = programs.make(name, solver=solver)(np.array([-1.0, 2.0]), rows)
        np.testing.assert_allclose(result.u, expected.u, atol=2e-6, err_msg=solver)
        assert result.status is expected.status


@pytest.mark.parametrize("solver", ["daqp", "clarabel"])
@pytest.mark.parametrize("name", NAMES)
def test_a_solver_by_name_agrees_with_the_core_beyond_the_plane(name, solver):
    rng = np.random.default_rng(2)
    for n_u in (1, 3, 5):
        box = Box.symmetric(4.0, n_u=n_u)
        core, named = (programs.make(name, input_set=box, solver=one) for one in (None, solver))
        for _ in range(10):
            rows = rows_of(rng.normal(0.0, 1.0, (5, n_u)), rng.normal(0.0, 5.0, 5), [1, 2, 3, 2, 1])
            u_nominal = rng.normal(0.0, 3.0, n_u)
            one, other = core(u_nominal, rows), named(u_nominal, rows)
            np.testing.assert_allclose(one.u, other.u, atol=2e-6)
            np.testing.assert_allclose(one.delta, other.delta, atol=2e-5)
            assert one.status is other.status


def test_a_point_of_the_core_meets_the_optimality_conditions():
    rng = np.random.default_rng(3)
    for n in (1, 2, 4, 12):
        for _ in range(50):
            a, inside, c = rng.normal(0.0, 1.0, (64, n)), rng.normal(0.0, 1.0, n), np.zeros(n)
            b = a @ inside - rng.exponential(1.0, 64) * (rng.random(64) < 0.9)
            x = _core.nearest_point(a, b, c)
            assert x is not None
            assert (a @ x >= b - 1e-9).all()
            # x - c is a combination of active rows with multipliers that are not negative
            active = a[a @ x <= b + 1e-7]
            _, residual = scipy.optimize.nnls(active.T, x - c) if len(active) else (0.0, 0.0)
            assert residual == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_beyond_the_plane_the_input_is_in_the_set_even_where_squares_overflow(name):
    rng = np.random.default_rng(9)

    def numbers(*shape):
        return rng.normal(0.0, 1.0, shape) * 10.0 ** rng.uniform(-300.0, 300.0, shape)

    program = programs.make(name, input_set=Box.symmetric(5.0, n_u=3))
    for _ in range(200):
        rows = CbfRows(numbers(4, 3), numbers(4), numbers(4), np.array([1, 2, 3, 2]), numbers(4))
        assert (np.abs(program(numbers(3), rows).u) <= 5.0).all()
