"""The statements of the paper's section III, and what takes their place where they fall short."""

import itertools

import daqp
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from benchmarks.suites.verify_programs import random_rows
from hcbf_gym import _core, programs
from hcbf_gym.barriers import LinearClassK, LogClassK
from hcbf_gym.models import Box
from hcbf_gym.programs import CbfRows, FilterStatus

seeds = st.integers(0, 10**6)
BOX = Box.symmetric(5.0)


def one(rows, i=0):
    return CbfRows(*(field[i] for field in rows if field is not None))


def plain_problem(seed, m, levels):
    """Rows of ordinary size and a nominal input, m rows in the given priorities."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 2.0 * np.pi, m)
    length = rng.uniform(0.5, 2.0, m)
    a = length[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    psi = rng.normal(0.0, 1.0, m)
    rows = CbfRows(a, length * rng.normal(0.0, 4.0, m), psi, np.array(levels), 2.0 * psi)
    return rng.normal(0.0, 3.0, 2), rows


def two_rows(seed):
    return plain_problem(seed, 2, [1, 2])


def alone(u_nominal, rows, k):
    """û_k: the program of row k alone."""
    row = CbfRows(rows.a[k : k + 1], rows.b[k : k + 1], rows.h[k : k + 1], np.array([1]))
    return programs.make("cbf-qp")(u_nominal, row).u


# ------------------------------------------------------------------ Proposition 1


def test_an_infeasible_pair_is_found_and_reported():
    # h2 = -h1 - 1: what raises one lowers the other (the proof's beta1 = 1, beta2 = -1)
    h1, alpha1 = 0.2, LinearClassK(1.0)
    h2 = -h1 - 1.0
    a = np.array([[1.0, 0.5], [-1.0, -0.5]])
    feasible_gain = -alpha1(h1) / h2  # K1 and K2 then touch: -alpha2(h2) = alpha1(h1)
    for gain, conflict in ((0.9 * feasible_gain, False), (1.1 * feasible_gain, True)):
        alpha2 = LinearClassK(gain)
        b = np.array([-alpha1(h1), -alpha2(h2)])
        rows = CbfRows(a, b, np.array([h1, h2]), np.array([1, 2]))
        result = programs.make("cbf-qp")(np.zeros(2), rows)
        report = programs.conflict_report(rows, result, BOX)
        assert (result.status is FilterStatus.VIOLATED) == conflict
        assert (report is not None) == conflict
        if report is not None:
            assert report.rows == (0, 1)
            assert not report.needs_input_set


# ------------------------------------------------------------------ the conflict report


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_a_reported_subset_is_infeasible_and_irreducible(seed):
    u_nominal, rows = plain_problem(seed, 5, [1, 2, 2, 3, 4])
    program = programs.make("cbf-qp")
    result = program(u_nominal, rows)
    report = programs.conflict_report(rows, result, BOX)
    if report is None:
        assert not result.slack.any()
        return

    def slack_of(kept):
        few = CbfRows(rows.a[kept], rows.b[kept], rows.h[kept], np.ones(len(kept), dtype=int))
        return program(np.zeros(2), few).slack

    kept = list(report.rows)
    assert len(kept) <= 3  # Helly: three half-planes suffice in the plane
    assert slack_of(kept).any()
    for row in kept:
        assert not slack_of([other for other in kept if other != row]).any()
    unit = rows.a[kept] / np.linalg.norm(rows.a[kept], axis=1)[:, None]
    crossings = [np.linalg.det(pair) for pair in itertools.combinations(unit, 2)]
    # nearly parallel rows meet farther away than the box below reaches
    assume(np.abs(crossings).min(initial=1.0) > 1e-3)
    wide = programs.make("cbf-qp", input_set=Box.symmetric(1e4))
    few = CbfRows(rows.a[kept], rows.b[kept], rows.h[kept], np.ones(len(kept), dtype=int))
    assert report.needs_input_set == (not wide(np.zeros(2), few).slack.any())


def test_the_report_names_who_pays_and_prefers_high_priorities():
    a = np.array([[1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    rows = CbfRows(a, np.array([2.0, -1.0, 1.0, 0.0]), np.ones(4), np.array([1, 2, 3, 4]))
    result = programs.make("lex-cbf-qp")(np.zeros(2), rows)
    report = programs.conflict_report(rows, result, BOX)
    assert report is not None
    assert report.rows == (0, 1)
    assert report.paid == pytest.approx({2: 1.0, 3: 3.0})
    calm = rows._replace(b=np.full(4, -1.0))
    assert programs.conflict_report(calm, result, BOX) is None


# ------------------------------------------------------------------ Remark 1, the offset


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_remark_1_without_a_price_on_u_the_least_offset_is_reached(seed):
    u_nominal, rows = two_rows(seed)
    rows = rows._replace(b=np.array([-50.0, rows.b[1]]))  # row 1 does not interfere
    program = programs.make("r-cbf-qp", lambda_u=0.0, epsilon="known")
    result = program(u_nominal, rows)
    psi = rows.h[1]
    least = max(0.0, -2.0 * psi)  # alpha2(psi + eps) - alpha2(psi), eps = max(0, -psi)
    reachable = 5.0 * np.abs(rows.a[1]).sum() >= rows.b[1] - least
    if reachable:
        assert result.delta[1] == pytest.approx(least, abs=1e-7)
        # alpha2(psi + c) = alpha2(psi) + delta: the offset is epsilon itself
        offset = programs.equivalent_offset(LinearClassK(2.0), psi, result.delta[1])
        assert offset == pytest.approx(max(0.0, -psi), abs=1e-7)
    else:
        assert result.delta[1] > least


@given(psi=st.floats(-3.0, 3.0), delta=st.floats(0.0, 2.0))
def test_the_offset_solves_its_definition(psi, delta):
    for alpha in (LinearClassK(2.0), LogClassK()):
        c = programs.equivalent_offset(alpha, psi, delta)
        assert alpha(psi + c) == pytest.approx(alpha(psi) + delta, abs=1e-9)
        assert c >= -1e-12


# ------------------------------------------------------------------ Corollaries 1 and 2


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
@pytest.mark.parametrize("name", ["r-cbf-qp", "h-cbf-qp", "ih-cbf-qp", "eh-cbf-qp"])
def test_corollaries_1_and_2_without_weight_the_lower_row_vanishes(name, seed):
    u_nominal, rows = two_rows(seed)
    result = programs.make(name, gamma0=0.0)(u_nominal, rows)
    np.testing.assert_allclose(result.u, alone(u_nominal, rows, 0), atol=1e-7)


# ------------------------------------------------------------------ Proposition 2, corrected


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_proposition_2_without_a_price_on_u_h_minimises_the_distance_in_m(seed):
    u_nominal, rows = two_rows(seed)
    hat, a = alone(u_nominal, rows, 1), rows.a[1]
    metric = np.outer(a, a)
    # M is only semidefinite, where the paper calls it definite: ties are broken towards u*
    np.testing.assert_allclose(np.linalg.eigvalsh(metric), [0.0, a @ a], atol=1e-12)
    delta_u = hat - u_nominal

    def cost(u):
        return (u_nominal - u) @ metric @ (u_nominal - u) - 2.0 * delta_u @ metric @ (u - u_nominal)

    result = programs.make("h-cbf-qp", lambda_u=0.0)(u_nominal, rows)
    grid = np.stack(np.meshgrid(*[np.linspace(-5.0, 5.0, 41)] * 2), axis=-1).reshape(-1, 2)
    allowed = grid[grid @ rows.a[0] >= rows.b[0]]
    assume(len(allowed))
    assert cost(result.u) <= min(cost(u) for u in allowed) + 1e-8
    # among the inputs of the same cost, none is nearer u*
    same = allowed[np.abs(allowed @ a - result.u @ a) < 1e-9]
    gap = np.linalg.norm(result.u - u_nominal)
    assert all(np.linalg.norm(u - u_nominal) >= gap - 1e-7 for u in same)


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_r_and_h_agree_while_the_relaxed_row_is_active_inside_the_set(seed):
    u_nominal, rows = two_rows(seed)
    u_nominal = np.clip(u_nominal, -4.0, 4.0)
    hat = alone(u_nominal, rows, 1)
    r = programs.make("r-cbf-qp")(u_nominal, rows)
    h = programs.make("h-cbf-qp")(u_nominal, rows)
    assume(rows.a[1] @ u_nominal < rows.b[1] and np.abs(hat).max() < 5.0 and r.slack[1] > 0.0)
    np.testing.assert_allclose(r.u, h.u, atol=1e-7)


# ------------------------------------------------------------------ Corollary 3


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_corollary_3_eh_keeps_what_an_earlier_stage_decided(seed):
    u_nominal, rows = plain_problem(seed, 4, [1, 2, 3, 4])
    program = programs.make("eh-cbf-qp")
    full = program(u_nominal, rows)
    for m in (2, 3):
        fewer = program(u_nominal, CbfRows(*(field[:m] for field in rows if field is not None)))
        np.testing.assert_allclose(full.delta[1:m], fewer.delta[1:m], atol=1e-6)


def test_eh_pins_the_input_even_where_no_row_is_near():
    rows = CbfRows(
        np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
        np.array([-9.0, 2.0, -9.0, 4.0]),
        np.ones(4),
        np.array([1, 2, 3, 4]),
    )
    eh = programs.make("eh-cbf-qp", gamma0=100.0)(np.array([0.0, 1.0]), rows)
    lex = programs.make("lex-cbf-qp")(np.array([0.0, 1.0]), rows)
    assert eh.slack[3] > 0.5  # row 3 is 10 from its bound, and yet u_y may not move any more
    assert not lex.slack.any()


# ------------------------------------------------------------------ Lex-CBF-QP


@settings(max_examples=80, deadline=None)
@given(seed=seeds)
@example(seed=13534)  # a step that worsens its level by 8e-7
def test_no_level_can_be_improved_without_worsening_a_higher_one(seed):
    u_nominal, rows = plain_problem(seed, 5, [1, 2, 2, 3, 4])
    batch = CbfRows(*(field[None] for field in rows if field is not None))
    best = programs.make_batch("lex-cbf-qp")(u_nominal[None], batch).u[0]

    def costs(u):
        lack = np.maximum(0.0, rows.b - rows.a @ u)
        levels = [np.linalg.norm(lack[rows.priority == p]) for p in range(1, 5)]
        return np.array([*levels, np.linalg.norm(u - u_nominal)])

    here = costs(best)
    rng = np.random.default_rng(seed)
    for size in (0.01, 0.1, 3.0):
        for step in rng.normal(0.0, size, (60, 2)):
            change = costs(np.clip(best + step, -5.0, 5.0)) - here
            first = change[np.abs(change) > 1e-11 * (1.0 + here)]
            # a gain of d costs a higher level no less than some d², which has to be seen
            assert not first.size or first[0] > -1e-5


@settings(max_examples=60, deadline=None)
@given(seed=seeds, cut=st.integers(1, 4))
def test_a_higher_level_never_depends_on_a_lower_row(seed, cut):
    u_nominal, rows = plain_problem(seed, 5, [1, 2, 2, 3, 4])
    program = programs.make("lex-cbf-qp")
    full, upper = program(u_nominal, rows), rows.priority <= cut
    fewer = CbfRows(*(field[upper] for field in rows if field is not None))
    np.testing.assert_allclose(full.slack[upper], program(u_nominal, fewer).slack, atol=1e-7)


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_lex_agrees_with_the_hierarchy_that_daqp_solves_itself(seed):
    u_nominal, rows = plain_problem(seed, 4, [1, 2, 3, 4])
    result = programs.make("lex-cbf-qp")(u_nominal, rows)
    upper = np.concatenate((np.full(2, 5.0), np.full(4, np.inf)))
    lower = np.concatenate((np.full(2, -5.0), rows.b))
    breaks = np.array([2, 3, 4, 5, 6], dtype=np.intc)
    x, _, flag, _ = daqp.solve(
        np.eye(2), -u_nominal, rows.a, upper, lower, np.zeros(6, dtype=np.intc), breaks
    )
    assert flag >= 1
    # DAQP's levels are soft ones of finite stiffness
    np.testing.assert_allclose(np.maximum(0.0, rows.b - rows.a @ x), result.slack, atol=2e-3)


@settings(max_examples=60, deadline=None)
@given(seed=seeds)
def test_a_level_of_finite_weight_tends_to_a_strict_one(seed):
    u_nominal, rows = plain_problem(seed, 3, [1, 2, 3])
    strict = programs.make("lex-cbf-qp")(u_nominal, rows)
    traded = [
        programs.make("lex-cbf-qp", weights=[None, weight])(u_nominal, rows)
        for weight in (0.1, 1.0, 1e6)
    ]
    violations = [result.slack[1] for result in traded]
    assert violations[0] >= violations[1] - 1e-9
    assert violations[1] >= violations[2] - 1e-9
    np.testing.assert_allclose(traded[-1].slack[1], strict.slack[1], atol=1e-3)


def test_lex_with_one_finite_level_is_r_cbf_qp():
    for seed in range(50):
        u_nominal, rows = two_rows(seed)
        lex = programs.make("lex-cbf-qp", weights=[None, 3.0], delta_gamma=1.3)
        r = programs.make("r-cbf-qp", gamma0=3.0, delta_gamma=1.3)
        np.testing.assert_allclose(lex(u_nominal, rows).u, r(u_nominal, rows).u, atol=1e-7)


# ------------------------------------------------------------------ weights


@settings(max_examples=40, deadline=None)
@given(seed=seeds)
@pytest.mark.parametrize("name", ["r-cbf-qp", "h-cbf-qp"])
def test_more_weight_never_relaxes_more(name, seed):
    u_nominal, rows = two_rows(seed)
    deltas = [
        abs(programs.make(name, gamma0=gamma0)(u_nominal, rows).delta[1])
        for gamma0 in (0.01, 0.1, 1.0, 10.0, 1e3)
    ]
    assert (np.diff(deltas) <= 1e-7).all()


def test_weights_follow_the_papers_law():
    program = programs.make("h-cbf-qp", gamma0=[2.0, 3.0], delta_gamma=1.5)
    table = program.prices.weights[0]
    ranked = [(2, 0.5), (2, -2.0), (3, -1.0), (4, -1.0)]
    weights = [_core.row_weight(table, rank, h) for rank, h in ranked]
    np.testing.assert_allclose(weights, [2.0, 2.0 * 4.0, 3.0 * 2.5, 3.0 * 2.5])


def test_rows_of_one_priority_are_one_stage_whatever_their_order():
    rng = np.random.default_rng(5)
    rows = one(random_rows(rng, 1, 6))
    for name in programs.names():
        program = programs.make(name)
        expected = program(np.array([1.0, -2.0]), rows)
        for _ in range(5):
            order = rng.permutation(6)
            mixed = CbfRows(*(field[order] for field in rows if field is not None))
            result = program(np.array([1.0, -2.0]), mixed)
            np.testing.assert_allclose(result.u, expected.u, atol=1e-7)
            np.testing.assert_allclose(result.slack, expected.slack[order], atol=1e-7)
