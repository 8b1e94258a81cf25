"""Functions made anew neither compile for ever nor pile up."""

import gc
import time
import warnings

import numpy as np
import pytest
from needs import remedy

jax = pytest.importorskip("jax", reason=remedy("jax"))
jnp = jax.numpy

from hcbf_gym.barriers import Function, GeneralRows, LinearClassK, function_cache  # noqa: E402
from hcbf_gym.errors import InvalidInputError  # noqa: E402
from hcbf_gym.models import SingleIntegrator, autodiff  # noqa: E402


def rows_of():
    return GeneralRows(SingleIntegrator(), LinearClassK(2.0), LinearClassK(2.0))


def clear(x, t, p):
    return jnp.hypot(x[0] - p[0], x[1] - p[1]) - p[2]


def expected(x, p):
    distance = np.hypot(x[0] - p[0], x[1] - p[1])
    return (x - p[:2]) / distance, -2.0 * (distance - p[2])


def test_a_new_closure_in_each_of_200_steps_compiles_at_most_nine_times_and_warns_once():
    make, x, rng = rows_of(), np.zeros(2), np.random.default_rng(0)
    slowest, objects = 0.0, []
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        for k in range(200):
            p = np.array([*rng.normal(3.0, 0.3, 2), 1.0])
            new = Function("seen", 1, lambda x, t, p=p: clear(x, t, p))
            began = time.process_time()  # which other processes do not lengthen
            rows = make([new], x)
            if k > function_cache.MAX_TUPLES + 2:
                slowest = max(slowest, time.process_time() - began)
            a, b = expected(x, p)
            np.testing.assert_allclose(rows.a[0], a, atol=1e-12)
            np.testing.assert_allclose(rows.b[0], b, atol=1e-12)
            if k in (60, 199):
                gc.collect()
                objects.append(len(gc.get_objects()))
    assert len(make.functions.by_tuple) + len(make.functions.by_function) <= 9
    assert len(warned) == 1
    assert "parameters=p" in str(warned[0].message)
    assert objects[1] - objects[0] < 2000
    assert slowest < 1.0  # nothing was compiled


def test_with_parameters_it_compiles_once_and_every_value_counts():
    make, rng = rows_of(), np.random.default_rng(0)
    for _ in range(200):
        x, p = rng.normal(size=2), np.array([*rng.normal(3.0, 0.3, 2), 1.0])
        rows = make([Function("seen", 1, clear, parameters=p)], x)
        a, b = expected(x, p)
        np.testing.assert_allclose(rows.a[0], a, atol=1e-12)
        np.testing.assert_allclose(rows.b[0], b, atol=1e-12)
    assert len(make.functions.by_tuple) == 1
    assert not make.functions.by_function


def test_a_number_of_functions_that_changes_compiles_each_one_once(monkeypatch):
    monkeypatch.setattr(function_cache, "MAX_TUPLES", 2)
    make, rng = rows_of(), np.random.default_rng(0)
    for count in (1, 2, 3, 4, 6, 2, 5):
        p = rng.normal(4.0, 0.5, (count, 3))
        seen = [Function(f"seen {k}", 1 + (k > 1), clear, parameters=p[k]) for k in range(count)]
        rows = make(seen, np.zeros(2))
        np.testing.assert_array_equal(rows.priority, [1 + (k > 1) for k in range(count)])
        for k in range(count):
            np.testing.assert_allclose(rows.b[k], expected(np.zeros(2), p[k])[1], atol=1e-12)
    assert len(make.functions.by_tuple) == 2
    assert len(make.functions.by_function) == 1


def test_parameters_are_part_of_a_function():
    one, same = (Function("f", 1, clear, parameters=[1.0, 2.0, 0.5]) for _ in range(2))
    other = Function("f", 1, clear, parameters=[1.0, 2.0, 0.6])
    assert one == same
    assert hash(one) == hash(same)
    assert one != other
    assert one.h(np.zeros(2)) == pytest.approx(np.sqrt(5.0) - 0.5)
    assert other.h(np.zeros(2)) == pytest.approx(np.sqrt(5.0) - 0.6)
    for wrong in (["a"], [np.nan], [[1.0], 2.0], [None]):
        with pytest.raises(InvalidInputError, match="parameters"):
            Function("f", 1, clear, parameters=wrong)


def test_jax_in_a_fork_of_a_process_in_which_it_ran_is_refused_and_not_waited_for(monkeypatch):
    Function("f", 1, lambda x, t: x[0]).h(np.ones(2))
    monkeypatch.setattr(autodiff.os, "getpid", lambda: -1)
    with pytest.raises(InvalidInputError, match=r'context="spawn"'):
        Function("f", 1, lambda x, t: x[1]).h(np.ones(2))
