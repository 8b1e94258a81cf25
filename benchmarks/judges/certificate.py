"""A stage's solution, guessed in doubles and proven in rational arithmetic: no tolerance.

A stage is ``min λ ‖u − u*‖² + Σ w_k v_k²`` over ``A u ≥ b``, where ``v_k = t_k − a_k u`` or, of
one-sided rows, ``max(m_k, t_k − a_k u)``. Pivots in doubles (Lemke) say which hard rows are tight
and which soft rows pay. For that guess the conditions of optimality are linear equations; their
rational solution is checked against every inequality, so that no guess can pass that is wrong. An
inequality that it breaks corrects the guess; where that leads nowhere, the pivots run in rational
numbers (`exact`). Nothing here is shared with the programs that are judged.
"""

from typing import Any, NamedTuple

import numpy as np

from benchmarks.judges import exact
from benchmarks.judges.exact import common_multiple, exactly, rational
from hcbf_gym.arrays import Array, Integers, Mask

Rationals = list[Any]

FREE, PAID, KINK = range(3)
"""What is guessed of a soft row: not paid for, paid for, at ``v_k = m_k``."""
SURE = 1e-13
"""A sum of doubles beyond this share of its terms has the sign of the exact one: rounding stays
below (n + 3) 2⁻⁵³ of them."""
LOOSE = 1e-10
"""What the guess gives hard rows of norm 1 beyond their bounds: what stages before have decided is
met without room, which rounding would make infeasible."""
PIVOTS = 300
"""Pivots in doubles before the guess is taken as it is."""
CORRECTIONS = 8
"""Rounds of correction of a guess before the pivots run in rational numbers."""


class Stage(NamedTuple):
    """One stage; gradients, u*, weights and least slacks are doubles, which are exact."""

    hard: Array  # (K, n) A
    bound: Rationals  # (K,) b, rational
    low: Array  # (n,) below all inputs
    u_nominal: Array  # (n,) u*
    lambda_u: float  # λ
    soft: Array  # (s, n) a
    target: Rationals  # (s,) t, rational
    weight: Array  # (s,) w > 0
    least: Array | None  # (s,) m ≥ 0, or None where rows are two-sided


def minimiser(stage: Stage) -> Rationals:
    """Return a minimiser u (n,) of a stage, in rational numbers."""
    return proven(stage, *guess(stage)) or by_pivots(stage)


def proven(stage: Stage, tight: Mask, states: Integers) -> Rationals | None:
    """Return a minimiser that a guess leads to, None if it leads to none."""
    bound, target = (np.array(numbers, np.float64) for numbers in (stage.bound, stage.target))
    for _ in range(CORRECTIONS):
        u_and_prices = solution(stage, tight, states)
        if u_and_prices is None:
            return None
        if not correct(stage, u_and_prices, bound, target, tight, states):
            return u_and_prices[: stage.low.size]
    return None


def guess(stage: Stage) -> tuple[Mask, Integers]:
    """Return which hard rows (K,) are tight, and what each soft row (s,) does.

    Rows are scaled to norm 1; those without a gradient stay out, paid for or not whatever u is.
    """
    bound, target = (np.array(numbers, np.float64) for numbers in (stage.bound, stage.target))
    acting, paying = (np.sqrt((rows * rows).sum(axis=1)) for rows in (stage.hard, stage.soft))
    hard, soft = acting > 0.0, paying > 0.0
    acting, paying = acting[hard], paying[soft]
    rows, bounds = stage.hard[hard] / acting[:, None], bound[hard] / acting - LOOSE
    units, goal = stage.soft[soft] / paying[:, None], target[soft] / paying
    price = stage.weight[soft] * paying**2
    scale = max(stage.lambda_u, float(price.max(initial=1e-300)))
    hessian, linear = np.eye(stage.low.size) * stage.lambda_u, -stage.lambda_u * stage.u_nominal
    tight, states = np.zeros(bound.size, dtype=np.bool_), np.full(target.size, PAID)
    if stage.least is None:
        hessian += (units.T * price) @ units
        linear -= (price * goal) @ units
        none = np.zeros(0)
        relaxed = units[:0], none, none, none
    else:
        states = np.where(target > stage.least, PAID, FREE)
        relaxed = units, goal, price / scale, stage.least[soft] / paying
    found, does = _sets(hessian / scale, linear / scale, rows, bounds, stage.low, *relaxed)
    tight[hard] = found
    if stage.least is not None:
        states[soft] = does
    return tight, states


def _sets(
    hessian: Array,
    linear: Array,
    hard: Array,
    bound: Array,
    low: Array,
    soft: Array,
    target: Array,
    weight: Array,
    least: Array,
) -> tuple[Mask, Integers]:
    """Return the same of rows of norm 1.

    The unknowns are u − low, v − m, and the multipliers of hard and of soft rows.
    """
    n, s, k = low.size, target.size, bound.size
    size = n + s + k + s
    u, v, holds, pays = np.split(np.arange(size), (n, n + s, n + s + k))
    matrix, q = np.zeros((size, size)), np.empty(size)
    matrix[:n, :n] = hessian
    matrix[:n, n + s : n + s + k] = -hard.T
    matrix[:n, n + s + k :] = -soft.T
    matrix[n + s : n + s + k, :n] = hard
    matrix[n + s + k :, :n] = soft
    matrix[v, v], matrix[v, pays], matrix[pays, v] = weight, -1.0, 1.0
    q[u] = linear + hessian @ low
    q[v] = weight * least
    q[holds] = hard @ low - bound
    q[pays] = soft @ low - target + least
    basic = _lemke(matrix, q)
    return basic[holds], np.where(basic[v], PAID, np.where(basic[pays], KINK, FREE))


def _lemke(matrix: Array, q: Array) -> Mask:
    """Return which y (n,) are basic in ``w = M y + q``, ``w, y ≥ 0``, ``w·y = 0``; see `exact`."""
    n = q.size
    row, artificial = int(q.argmin()), 2 * n
    basis, entering = np.arange(n), artificial
    if q[row] >= 0.0:
        return np.zeros(n, dtype=np.bool_)
    table = np.hstack((np.eye(n), -matrix, np.full((n, 1), -1.0), q[:, None]))
    for _ in range(PIVOTS):
        leaving, basis[row] = int(basis[row]), entering
        table[row] /= table[row, entering]
        factor = table[:, entering].copy()
        factor[row] = 0.0
        table -= factor[:, None] * table[row]
        if leaving == artificial:
            break
        entering = leaving + n if leaving < n else leaving - n
        possible = np.flatnonzero(table[:, entering] > 1e-11)
        if not possible.size:
            break
        ratio = np.maximum(table[possible, -1], 0.0) / table[possible, entering]
        least = ratio.min()
        tied = possible[ratio <= least + 1e-11 * (1.0 + least)]
        row = int(tied[(basis[tied] == artificial).argmax()])  # of the artificial one, if it ties
    return np.isin(np.arange(n, 2 * n), basis)


def solution(stage: Stage, tight: Mask, states: Integers) -> Rationals | None:
    """Return u, then the multipliers of tight rows and kinks; None where they are not determined.

    ``λ(u − u*) − Σ_paid w v a − Σ μ A_tight − Σ ν a_kink = 0``, and the tight rows themselves.
    """
    n, zero, price = stage.low.size, rational(0), rational(stage.lambda_u)
    desired = [rational(x) for x in stage.u_nominal.tolist()]
    square = [[price if i == j else zero for j in range(n)] for i in range(n)]
    right = [price * x for x in desired]
    for k in np.flatnonzero(states == PAID).tolist():
        a = [rational(x) for x in stage.soft[k].tolist()]
        weight = rational(float(stage.weight[k]))
        for i in range(n):
            weighted = weight * a[i]
            if weighted:
                right[i] += weighted * stage.target[k]
                square[i] = [x + weighted * y for x, y in zip(square[i], a, strict=True)]
    ties = [_tie(stage.hard[k], stage.bound[k]) for k in np.flatnonzero(tight).tolist()]
    ties += [_tie(stage.soft[k], _edge(stage, k)) for k in np.flatnonzero(states == KINK).tolist()]
    count = len(ties)
    if count == n:  # the tight rows alone say where u is
        u = solve(ties)
        if u is None:
            return None
        pull = [_product(row, u) - value for row, value in zip(square, right, strict=True)]
        prices = solve([[tie[i] for tie in ties] + [pull[i]] for i in range(n)])
        return None if prices is None else u + prices
    balance = [square[i] + [-tie[i] for tie in ties] + [right[i]] for i in range(n)]
    return solve([tie[:n] + [zero] * count + [tie[n]] for tie in ties] + balance)


def correct(
    stage: Stage, solution: Rationals, bound: Array, target: Array, tight: Mask, states: Integers
) -> bool:
    """Correct the guess in place where its solution breaks an inequality; tell whether it did.

    All inequalities are compared in rational numbers, but for those whose doubles leave no doubt.
    """
    n, wrong = stage.low.size, False
    u, prices = solution[:n], iter(solution[n:])
    point = np.array(u, dtype=np.float64)
    let_go = [k for k in np.flatnonzero(tight).tolist() if next(prices) < 0]
    broken = [
        k
        for k in _doubtful(stage.hard, bound, point).tolist()
        if not tight[k] and dot(stage.hard[k], u) < stage.bound[k]
    ]
    tight[let_go], tight[broken] = False, True
    if stage.least is None:
        return bool(let_go or broken)
    kinks = np.flatnonzero(states == KINK).tolist()
    below = set(_doubtful(stage.soft, target - stage.least, point).tolist())
    above = set(_doubtful(-stage.soft, stage.least - target, point).tolist())
    for k in range(len(states)):
        if states[k] == FREE and k in below and dot(stage.soft[k], u) < _edge(stage, k):
            states[k], wrong = PAID, True
        elif states[k] == PAID and k in above and dot(stage.soft[k], u) > _edge(stage, k):
            states[k], wrong = FREE, True
    for k in kinks:
        price = next(prices)
        most = rational(float(stage.weight[k])) * rational(float(stage.least[k]))
        if price < 0 or price > most:
            states[k], wrong = FREE if price < 0 else PAID, True
    return bool(let_go or broken or wrong)


def _doubtful(a: Array, bound: Array, point: Array) -> Integers:
    """Return the rows (k,) of which doubles do not show beyond doubt that ``a_k u > b_k``."""
    terms = a * point
    value, size = terms.sum(axis=1) - bound, np.abs(terms).sum(axis=1) + np.abs(bound)
    return np.flatnonzero(~(value > SURE * size))


def _edge(stage: Stage, k: int) -> Any:
    """Return ``t_k − m_k``, the value of a_k u above which row k is not paid for."""
    least = 0.0 if stage.least is None else float(stage.least[k])
    return stage.target[k] - rational(least) if least else stage.target[k]


def _tie(a: Array, value: Any) -> Rationals:
    """Return the equation ``a u = value``."""
    return [*(rational(x) for x in a.tolist()), value]


def _product(row: Rationals, u: Rationals) -> Any:
    return sum((x * y for x, y in zip(row, u, strict=True) if x), rational(0))


def dot(a: Array, u: Rationals) -> Any:
    """Return a·u in rational numbers."""
    return sum((rational(x) * y for x, y in zip(a.tolist(), u, strict=True) if x), rational(0))


def solve(equations: list[Rationals]) -> Rationals | None:
    """Return the solution of N equations in N unknowns, None where they are dependent."""
    table = [_integers(equation) for equation in equations]
    size, divisor = len(table), 1
    for column in range(size):
        found = next((i for i in range(column, size) if table[i][column]), None)
        if found is None:
            return None
        table[column], table[found] = table[found], table[column]
        top = table[column]
        pivot = top[column]
        for i in range(column + 1, size):
            row, factor = table[i], table[i][column]
            table[i] = [0] * (column + 1) + [
                (pivot * row[j] - factor * top[j]) // divisor for j in range(column + 1, size + 1)
            ]
        divisor = pivot
    x: Rationals = [rational(0)] * size
    for i in reversed(range(size)):
        row = table[i]
        rest = sum((row[j] * x[j] for j in range(i + 1, size) if row[j]), rational(0))
        x[i] = (row[size] - rest) / row[i]
    return x


def _integers(numbers: Rationals) -> list[Any]:
    """Return rational numbers times their common denominator."""
    common = common_multiple(*(number.denominator for number in numbers))
    return [number.numerator * (common // number.denominator) for number in numbers]


def by_pivots(stage: Stage) -> Rationals:
    """Minimise by pivots in rational numbers, which need no guess."""
    n, s, low = stage.low.size, len(stage.target), exactly(stage.low)
    hard, soft, weight = exactly(stage.hard), exactly(stage.soft), exactly(stage.weight)
    price, desired = rational(stage.lambda_u), exactly(stage.u_nominal)
    bound = np.array(stage.bound, dtype=object) - hard @ low
    target = np.array(stage.target, dtype=object)
    hessian = exactly(np.eye(n)) * price
    if stage.least is None:
        hessian = hessian + (soft.T * weight) @ soft
        linear = hessian @ low - price * desired - (soft.T * weight) @ target
        return (low + exact.quadratic_program(hessian, linear, hard, bound)).tolist()
    least, whole = exactly(stage.least), exact.zeros(n + s, n + s)
    whole[:n, :n], whole[range(n, n + s), range(n, n + s)] = hessian, weight
    linear = np.concatenate((price * (low - desired), weight * least))
    rows = np.vstack(
        (np.hstack((hard, exact.zeros(len(hard), s))), np.hstack((soft, exactly(np.eye(s)))))
    )
    wanted = np.concatenate((bound, target - least - soft @ low))
    return (low + exact.quadratic_program(whole, linear, rows, wanted)[:n]).tolist()
