import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym.barriers import Disc, HalfPlane, kernels
from hcbf_gym.barriers.class_k import LinearClassK, LogClassK
from hcbf_gym.barriers.held import disc_curvature, hold_rows, reach
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.studies.monte_carlo import episodes as monte_carlo

DT, U_MAX = 0.02, 5.0 * np.sqrt(2.0)
ALPHA2 = LinearClassK(2.0)


def held(barriers, x, t, alpha1):
    usual = barriers.rows(x, t, alpha1, ALPHA2)
    is_disc = barriers.kind == kernels.DISC
    radius = np.where(is_disc, barriers.parameters[..., 4], np.inf)
    relative = x[:, None, 2:] - barriers.parameters[..., :2]
    curvature = disc_curvature(usual.h, radius, reach(relative, DT, U_MAX))
    rows = hold_rows(
        usual.h, usual.a, relative, curvature, barriers.priority, alpha1, ALPHA2, DT, U_MAX
    )
    return usual, rows


def psi(barriers, x, t, alpha1):
    return barriers.rows(x, t, alpha1, ALPHA2).alpha2_psi / ALPHA2.gain


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
@pytest.mark.parametrize("alpha1", [LogClassK(), LinearClassK(3.0)])
def test_an_input_that_meets_the_row_keeps_psi_and_h_until_the_next_sample(alpha1, seed):
    rng = np.random.default_rng(seed)
    n = 50
    discs = [
        Disc("disc", 1, (0.0, 0.0), rng.uniform(0.3, 3.0), tuple(rng.uniform(-0.5, 0.5, 2)))
        for _ in range(n)
    ]
    wall = HalfPlane("wall", 1, (0.6, 0.8), -1.0)
    barriers = BarrierSet([(disc, wall) for disc in discs])
    x = np.concatenate((rng.normal(0.0, 2.5, (n, 2)), rng.normal(0.0, 1.5, (n, 2))), axis=1)
    t = np.zeros(n)
    usual, rows = held(barriers, x, t, alpha1)
    start = psi(barriers, x, t, alpha1)
    # on the row itself, and with whatever sideways part U allows
    a = rows.a / np.linalg.norm(rows.a, axis=-1, keepdims=True)
    sideways = np.stack((-a[..., 1], a[..., 0]), axis=-1)
    for k in range(2):
        level = rows.b[:, k] / np.linalg.norm(rows.a[:, k], axis=-1)
        for share in (-1.0, 0.0, 1.0):
            room = np.sqrt(np.maximum(0.0, U_MAX**2 - level**2))
            u = level[:, None] * a[:, k] + share * room[:, None] * sideways[:, k]
            meets = (np.abs(level) <= U_MAX) & (usual.h[:, k] >= 0.0) & (start[:, k] >= 0.0)
            least, end = usual.h.copy(), x.copy()
            monte_carlo.advance(
                barriers.kind, barriers.parameters, end, t, u, DT, 40, least, np.zeros((n, 2))
            )
            after = psi(barriers, end, t + DT, alpha1)
            kept = (1.0 - ALPHA2.gain * DT) * start
            assert (after[meets, k] >= kept[meets, k] - 1e-12).all()
            assert (least[meets, k] >= 0.0).all()


def test_the_row_tends_to_the_usual_one_as_the_hold_becomes_short():
    barriers = BarrierSet([(Disc("disc", 1, (2.0, 0.3), 1.0),)])
    x, t = np.array([[0.0, 0.0, 0.7, -0.4]]), np.zeros(1)
    usual = barriers.rows(x, t, LogClassK(), ALPHA2)
    gaps = []
    for dt in (1e-2, 1e-3, 1e-4):
        relative = x[:, None, 2:]
        curvature = disc_curvature(usual.h, np.array([[1.0]]), reach(relative, dt, U_MAX))
        rows = hold_rows(
            usual.h, usual.a, relative, curvature, usual.priority, LogClassK(), ALPHA2, dt, U_MAX
        )
        gaps.append(abs(float(rows.b[0, 0] - usual.b[0, 0])))
    assert gaps[1] < 0.2 * gaps[0]
    assert gaps[2] < 0.2 * gaps[1]


def test_sampling_slower_than_the_class_k_functions_is_refused():
    h = np.ones((1, 1))
    with pytest.raises(InvalidInputError, match="dt"):
        hold_rows(
            h, np.ones((1, 1, 2)), np.zeros((1, 1, 2)), (0.0 * h, 0.0 * h), np.ones((1, 1), int),
            LogClassK(), ALPHA2, 0.5, U_MAX,
        )  # fmt: skip


@pytest.mark.parametrize("policy", monte_carlo.POLICIES)
def test_lex_enters_no_priority_whose_rows_can_be_met(policy):
    summary = monte_carlo.summary(monte_carlo.run(policy, "lex", "held", 7, 0, 20))
    assert summary["entered_though_met"] == [0, 0, 0, 0]
    assert summary["entered"][0] == 0.0
    assert summary["least_clearance"] >= 0.0
    assert summary["conflict"] == 1.0
    bare = monte_carlo.summary(monte_carlo.run(policy, "none", "held", 7, 0, 20))
    assert bare["entered"][0] > 0.2


def test_a_chunk_of_scenes_is_the_same_whatever_the_chunking():
    whole = monte_carlo.run("pd", "lex", "held", 3, 0, 6)
    parts = [
        *monte_carlo.run("pd", "lex", "held", 3, 0, 4),
        *monte_carlo.run("pd", "lex", "held", 3, 4, 2),
    ]
    assert whole == parts
