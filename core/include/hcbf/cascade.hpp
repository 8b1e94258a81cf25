// What a plan does stage by stage, and the programs of two inputs for N states, on polygons.
//
// The templates are the same for any number of inputs; see `general_cascade`.
#pragma once
#include <utility>

#include <hcbf/program_records.hpp>
#include <hcbf/soft_minimum.hpp>

namespace hcbf::cascade {

using namespace program_records;
using polygon::Corners;

// Returns gamma0 of a priority; infinity for a strict level. `table` (1 + L,): delta_gamma, then
// gamma0 of each priority from 2 on, the last one repeated.
inline double gamma0_of(Vector<const double> table, Index priority) {
  if (priority <= 1) return std::numeric_limits<double>::infinity();
  return table[std::min(priority - 1, table.size - 1)];
}

// Returns lambda(h) of one row; infinity for one of a strict level.
template <class Number>
Number weight_of(Vector<const double> table, Index priority, const Number& h) {
  return gamma0_of(table, priority) * (1.0 + table[0] * max(0.0, -h));
}

// Returns by how much a row is violated, 0 where that is rounding. `lack`: b - a u; `norm`: |a|;
// `radius`: the largest norm of an input.
template <class Number>
Number slack_of(const Number& lack, const Number& norm, const Number& b, double radius) {
  return lack > tolerances::SLACK * (norm * radius + abs(b)) ? lack : 0.0;
}

// Writes the slack (m,) of one state's rows at u.
inline void violation(Matrix<const double> a, Vector<const double> b, Vector<const double> u, double radius,
                      Vector<double> slack) {
  for (Index k = 0; k < b.size; ++k) {
    double square = 0.0, lack = b[k];
    for (Index j = 0; j < u.size; ++j) square += a(k, j) * a(k, j), lack -= a(k, j) * u[j];
    slack[k] = slack_of(lack, std::sqrt(square), b[k], radius);
  }
}

// Returns whether u* is in U and meets every row.
template <class Number>
bool allowed(Corners<Number> vertices, const StateRowsOf<Number>& rows, const PointOf<Number>& u_nominal) {
  for (Index k = 0; k < rows.b.size; ++k)
    if (rows.a(k, 0) * u_nominal.x + rows.a(k, 1) * u_nominal.y < rows.b[k]) return false;
  return polygon::contains<Number>(vertices, u_nominal);
}

// Returns the least slack of row k; with a known offset it is alpha2(psi + eps) - alpha2(psi), which is
// max(0, -alpha2(psi)).
template <class Number>
Number least_slack(const Settings& settings, const StateRowsOf<Number>& rows, Index k) {
  if (!settings.known_offset || rows.priority[k] <= 1) return 0.0;
  return max(0.0, -rows.alpha2_psi[k]);
}

// Returns the stage of the rows of a priority, from 1; of no row, which has priority 0, 0.
inline Index stage_of(const Settings& settings, Vector<const double> weights, Index priority) {
  if (settings.by_level || priority == 0) return priority;
  return std::isinf(gamma0_of(weights, priority)) ? 1 : 2;
}

// Sorts by stage: writes the rows' indices, and where each stage ends in `start`, one place early:
// stage s is from start[s - 1] to start[s]. Returns the number of stages.
template <class Row>
Index sort(const Settings& settings, Vector<const double> weights, Vector<const Index> priority,
           std::vector<Row>& rows, std::vector<Index>& start) {
  Index count = 0;
  for (const Index rank : priority) count = std::max(count, stage_of(settings, weights, rank));
  std::fill_n(start.begin(), count + 2, 0);
  for (const Index rank : priority) ++start[stage_of(settings, weights, rank)];
  Index total = 0;
  for (Index stage = 0; stage <= count; ++stage)  // start[s] becomes where stage s's rows are to go next
    total += std::exchange(start[stage], total);
  for (Index k = 0; k < priority.size; ++k)
    rows[start[stage_of(settings, weights, priority[k])]++].index = k;
  return count;
}

// Fills in all but the gradient of a row whose index is set.
template <class Number>
void load(const Settings& settings, Vector<const double> weights, const StateRowsOf<Number>& rows,
          TermsOf<Number>& row) {
  const Index k = row.index;
  row.b = rows.b[k];
  const Number weight = weight_of(weights, rows.priority[k], rows.h[k]);
  row.strict = isinf(weight);
  row.weight = row.strict ? 1.0 : weight;
  row.least = least_slack(settings, rows, k);
}

// Runs the stages on rows sorted by them, from U on; returns u. `inputs` are those that the stages so far
// leave, with what a stage does to them.
template <class Inputs, class Row>
auto decide(const Settings& settings, Vector<Row> rows, const Index* start, Index stage_count,
            Inputs& inputs) {
  if (settings.lower == Lower::DRAWN) inputs.set_targets(rows);
  decltype(inputs.nearest()) u{};
  bool found = false;
  for (Index stage = 0; stage < stage_count; ++stage) {
    const Vector<Row> some = rows.part(start[stage], start[stage + 1]);
    if (some.size == 0) continue;
    if (inputs.is_point()) break;  // nothing is left to decide
    if (some[0].strict)
      inputs.meet(some), found = false;
    else if (settings.lower == Lower::RELAXED)
      u = inputs.relax(some), found = true;
    else if (settings.lower == Lower::DRAWN)
      u = inputs.draw(some), found = true;
    if (found && settings.lock == Lock::PIN) inputs.pin(some, u);
    if (found && settings.lock == Lock::BOUND) inputs.bound(some, u);
  }
  return found ? u : inputs.nearest();
}

// Writes what each row pays at u; returns the status, given that of an input without slack.
template <class Row, class Input, class Number>
Index account(const Settings& settings, Index status, Vector<const Index> priority, Vector<Row> rows,
              const Input& u, Vector<Number> slack, Vector<Number> delta) {
  for (const Row& row : rows) {
    const Number value = row.value(u);
    const Number paid = slack_of<Number>(row.b - value, row.norm, row.b, settings.radius);
    slack[row.index] = delta[row.index] = paid;
    if (!row.strict && settings.lower == Lower::RELAXED) delta[row.index] = max(paid, row.least);
    if (!row.strict && settings.lower == Lower::DRAWN) delta[row.index] = row.target - value;
    if (paid > 0.0) {
      const bool relaxed = settings.ranks && priority[row.index] > 1;
      status = std::max<Index>(status, relaxed ? RELAXED : VIOLATED);
    }
  }
  return status;
}

// The inputs that the stages so far leave, `w.feasible`; each stage chooses from them, or narrows them.
template <class Number>
struct PlanarInputsOf {
  Vector<const PointOf<Number>> vertices;
  PointOf<Number> u_nominal;
  double lambda_u;
  WorkspaceOf<Number>& w;

  bool is_point() const { return w.feasible.corners.size() == 1; }
  PointOf<Number> nearest() const { return polygon::nearest<Number>(w.feasible, u_nominal); }

  // Writes a_k u_k of each row that is not strict, u_k its own program's solution over U.
  void set_targets(RowsOf<Number> rows) const {
    const PointOf<Number> nearest = polygon::nearest<Number>(vertices, u_nominal);
    for (RowOf<Number>& row : rows) {
      if (row.strict) continue;
      row.target = row.value(nearest);
      if (row.target >= row.b || !row.steers()) continue;
      w.trial.corners.assign(vertices.begin(), vertices.end());
      polygon::cut(w.trial, row.line(row.b), w.radius);
      row.target = row.value(polygon::nearest<Number>(w.trial, u_nominal));
    }
  }

  // Keeps the inputs that meet the rows or, where none does, violate them least (min sum delta^2).
  void meet(RowsOf<Number> rows) const {
    if (rows.size == 1) {  // a cut that cannot be met leaves the face of least violation
      if (rows[0].steers()) polygon::cut(w.feasible, rows[0].line(rows[0].b), w.radius);
      return;
    }
    w.trial.corners = w.feasible.corners;
    for (const RowOf<Number>& row : rows) {
      if (!row.steers()) continue;
      const LineOf<Number> line = row.line(row.b);
      if (polygon::span(w.trial, line.n).high < line.d - tolerances::THIN * w.radius) {
        soft_minimum::keep_least(w.feasible, {rows, 0.0, {0.0, 0.0}}, w);
        return;
      }
      polygon::cut(w.trial, line, w.radius);
    }
    w.feasible.corners.swap(w.trial.corners);
  }

  // Returns argmin lambda_u |u - u*|^2 + sum lambda_k max(m_k, b_k - a_k u)^2; for lambda_u = 0 it is
  // the minimiser nearest u*.
  PointOf<Number> relax(RowsOf<Number> rows) const {
    const CostOf<Number> cost{rows, lambda_u, u_nominal};
    if (lambda_u > 0.0) return soft_minimum::soft_minimum(w.feasible, cost, w);
    w.trial.corners = w.feasible.corners;
    soft_minimum::keep_least(w.trial, cost, w);
    return polygon::nearest<Number>(w.trial, u_nominal);
  }

  // Returns argmin lambda_u |u - u*|^2 + sum lambda_k (t_k - a_k u)^2 with the rows' targets t_k.
  //
  // For lambda_u = 0 steep rows come first where flat ones would drown in their rounding, as in
  // `soft_minimum::keep_least`.
  PointOf<Number> draw(RowsOf<Number> rows) const {
    const auto minimum = [&](const PolygonOf<Number>& polygon) {
      auto problem = polygon::LeastSquaresOf<Number>::distance(lambda_u, u_nominal);
      for (const RowOf<Number>& row : rows) {
        const Number root = sqrt(row.weight);
        problem.add(root * row.a.x, root * row.a.y, root * row.target);
      }
      return polygon::minimise(polygon, problem, u_nominal, w.radius, w.chord);
    };
    PointOf<Number> u = minimum(w.feasible);
    if (lambda_u > 0.0) return u;
    w.trial.corners = w.feasible.corners;
    while (const double floor = soft_minimum::flattest_that_counts(rows)) {
      for (const RowOf<Number>& row : rows)
        if (sqrt(row.weight) * row.norm >= floor && !w.trial.is_point())
          polygon::slice_at(w.trial, row.through(u), w.radius);
      soft_minimum::drop(rows, floor);
      u = minimum(w.trial);
    }
    return u;
  }

  // Keeps the inputs at which each row has the value that it has at u.
  void pin(RowsOf<Number> rows, const PointOf<Number>& u) const {
    for (const RowOf<Number>& row : rows)
      if (row.steers() && !w.feasible.is_point()) polygon::slice_at(w.feasible, row.through(u), w.radius);
  }

  // Keeps the inputs at which no row is violated more than at u.
  void bound(RowsOf<Number> rows, const PointOf<Number>& u) const {
    for (const RowOf<Number>& row : rows) {
      if (!row.steers()) continue;
      const LineOf<Number> line = row.line(row.b);
      polygon::cut(w.feasible, {line.n, min(line.d, polygon::dot(line.n, u))}, w.radius);
    }
  }
};

// Filters one nominal input, U and the weights being those of its state, writing u (2,), slack (m,) and
// delta (m,); returns the status.
template <class Number>
Index filter_state(const Settings& settings, Vector<const PointOf<Number>> vertices,
                   Vector<const double> weights, const PointOf<Number>& u_nominal,
                   const StateRowsOf<Number>& rows, Vector<Number> u, Vector<Number> slack,
                   Vector<Number> delta, WorkspaceOf<Number>& w) {
  const Index m = slack.size;
  u[0] = u_nominal.x, u[1] = u_nominal.y;
  if (allowed<Number>(vertices, rows, u_nominal)) {
    for (Index k = 0; k < m; ++k) slack[k] = 0.0, delta[k] = least_slack(settings, rows, k);
    return NOMINAL;
  }
  const RowsOf<Number> sorted{w.rows.data(), m};
  const Index stage_count = sort(settings, weights, rows.priority, w.rows, w.start);
  for (RowOf<Number>& row : sorted) {
    load(settings, weights, rows, row);
    row.a = {rows.a(row.index, 0), rows.a(row.index, 1)};
    row.norm = hypot(row.a.x, row.a.y);
  }
  w.feasible.corners.assign(vertices.begin(), vertices.end());
  PlanarInputsOf<Number> inputs{vertices, u_nominal, settings.lambda_u, w};
  PointOf<Number> chosen = decide(settings, sorted, w.start.data(), stage_count, inputs);
  // squares of numbers beyond 1e150 overflow, and leave no minimum
  if (!isfinite(chosen.x) || !isfinite(chosen.y)) chosen = inputs.nearest();
  u[0] = chosen.x, u[1] = chosen.y;
  const Number distance = max(abs(chosen.x - u_nominal.x), abs(chosen.y - u_nominal.y));
  const bool moved = distance > tolerances::NOMINAL * (1.0 + settings.radius);
  const Index unpaid = moved ? SAFE : NOMINAL;
  return account(settings, unpaid, rows.priority, sorted, chosen, slack, delta);
}

// Filters the nominal inputs u_nominal (N, 2) of N states.
//
// rows: of N states, finite, priorities from 1 to LOWEST_RANK or m, or 0 of no row; alpha2_psi is an array even
// where the program does not read it. answer: written to.
inline void filter_batch(const Settings& settings, Matrix<const double> u_nominal, const CbfRows& rows,
                         const FilterResult& answer) {
  const Cube<const double>& vertices = settings.vertices;
  const Matrix<const double>& weights = settings.weights;
  Workspace w;
  w.grow(settings.radius, vertices.rows, rows.b.columns);
  for (Index i = 0; i < u_nominal.rows; ++i) {
    answer.status[i] = filter_state<double>(settings, polygon::points(vertices[vertices.layers > 1 ? i : 0]),
                                            weights[weights.rows > 1 ? i : 0], {u_nominal(i, 0), u_nominal(i, 1)},
                                            rows[i], answer.u[i], answer.slack[i], answer.delta[i], w);
    answer.fallbacks[i] = 0;
  }
}

}  // namespace hcbf::cascade
