"""What is known exactly of a held double integrator, and the tables that are made of it."""

import numpy as np
import pytest
from needs import needs

from benchmarks.ground_truth import filters, suite, truths
from benchmarks.suites import crossing

HELD = "held rows, α₂ = 10"


def states(n, speed=3.0, seed=0):
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-2.0, 2.0, (n, 2)), truths.of_speed(n, speed, rng)]


@pytest.mark.parametrize("truth", suite.TRUTHS)
def test_the_best_input_reaches_the_value_and_no_other_exceeds_it(truth):
    known = suite.TRUTHS[truth]()
    x = states(300)
    value, best = known.value(x), known.best(x)

    def reached(u):
        # until the robot moves as the input directs it
        end = np.maximum(np.hypot(x[:, 2], x[:, 3]) / 2.0, 0.1)[:, None]
        t = np.linspace(0.0, 1.0, 801)[:, None, None] * end
        return known.h(x[:, :2] + t * x[:, 2:] + 0.5 * t * t * u).min(axis=0)

    np.testing.assert_allclose(reached(best), value, atol=2e-3)
    for u in truths.BORDER:
        assert (reached(u) <= value + 5e-3).all(), u


def test_the_search_finds_what_braking_on_a_line_can_do():
    v = np.linspace(0.1, 3.0, 30)  # slowly, nothing is better; fast, a turn is
    x = np.c_[np.full(30, 3.0), np.zeros(30), -v, np.zeros(30)]
    braked = 3.0 - truths.RADIUS - v**2 / (2.0 * truths.REACH)
    found = truths.disc().value(x)
    assert (found >= braked - 1e-3).all()
    np.testing.assert_allclose(found[v < 0.8], braked[v < 0.8], atol=1e-3)


def test_two_discs_are_harder_to_avoid_than_one():
    x = truths.sample_pair(60, 3.0, np.random.default_rng(0))
    first, both = truths.pair_values(x)
    alone = truths.disc().value(x)
    assert (both <= first).all()
    assert (first >= alone - 0.03).all()  # it searches every second of those inputs, and two pieces
    assert ((first >= 0.0) & (both < 0.0)).any()


@pytest.mark.parametrize("truth", suite.TRUTHS)
def test_samples_are_of_the_kernel_and_held_rows_do_not_leave_their_own_set(truth):
    known = suite.TRUTHS[truth]()
    x = known.sample(200, 1.0, np.random.default_rng(0))
    assert (known.value(x) >= 0.0).all()
    assert (np.hypot(x[:, 2], x[:, 3]) <= 1.0).all()
    figures = suite.alone_figures(truth, HELD, 1.0, 200)
    assert (figures["false_accepts"], figures["entered_own"]) == (0, 0)
    assert 0.9 < figures["cover"] < 1.0
    assert 0.0 < figures["needless"] < 0.15
    least = suite.alone_figures(truth, filters.LEAST, 1.0, 100)
    assert (least["cover"], least["needless"]) == (1.0, 0.0)


def test_other_programs_answer_as_held_rows_do_where_there_is_one_condition():
    known = truths.wall()
    x = known.sample(100, 3.0, np.random.default_rng(0))
    u = known.aim(x)
    expected = filters.begin(HELD, [known.condition], x)(x, u)[0]
    for name in set(filters.RANKED) - set(filters.OURS):
        np.testing.assert_allclose(
            filters.begin(name, [known.condition], x)(x, u)[0], expected, atol=1e-9
        )


@needs("cbfpy")
def test_cbfpy_filters_many_states_and_its_set_follows_its_gains():
    known = truths.wall()
    x = np.array([[1.0, 0.0, -2.0, 0.0], [1.0, 0.0, -0.5, 0.0]])
    u, accepted = filters.begin("cbfpy, gains 1", [known.condition], x)(x, known.aim(x))
    assert accepted.tolist() == [False, True]
    assert u[1, 0] == pytest.approx(1.0 - 0.5 - 2.0 * 0.5 + 0.5, abs=0.6)
    assert filters.begin("cbfpy, gains 5", [known.condition], x)(x, u)[1].all()


def test_the_tables_have_every_filter_and_ranks_matter():
    alone = [suite.alone_figures("disc", HELD, speed, 20) for speed in suite.SPEEDS]
    alone += [one | {"truth": "half-plane"} for one in alone]
    ranks = [suite.ranks_figures(name, 60) for name in (HELD, "R")]
    tempo = [suite.tempo_figures(name) for name in ("held rows, α₂ = 2", HELD, filters.LEAST)]
    before, after, best = (one["sprint"] for one in tempo)
    assert before > after > best
    assert tempo[0]["rise"] > 3.0 * tempo[1]["rise"]
    assert ranks[1]["second"] > 10 * ranks[0]["second"]
    grid = {"grid": [3, 3], "band": 0.1, "states": 1, "decided": 1}
    grid |= {"search_missed": 0, "search_more": 0}
    made = suite.tables({"alone": alone, "tempo": tempo, "ranks": ranks, "grid": grid})
    assert set(made) == {*suite.TRUTHS, "tempo", "ranks", "grid"}
    assert [row[0] for row in made["ranks"].rows] == [HELD, "R"]


@pytest.mark.parametrize("intentions", ["known", "hidden"])
@pytest.mark.filterwarnings("ignore")  # faster than the cap in a conflict, at which it is stopped
@pytest.mark.parametrize("policy", ["pd", crossing.FULL])
def test_a_crossing_is_counted(intentions, policy):
    found = crossing.walk(intentions, policy, "lex-cbf-qp", 0, 12)
    amount = crossing.amount(found)
    assert amount["scenes"] == 12
    assert amount["arrives"] > 0.9
    assert 8.0 < amount["seconds"] < 16.0
    assert 0.0 < amount["changed"] < 1.0
    cells = [
        amount | {"intentions": i, "policy": policy, "filter": "lex-cbf-qp"}
        for i in ("known", "hidden")
    ]
    assert set(crossing.tables({"cells": cells})) == {"known", "hidden"}
