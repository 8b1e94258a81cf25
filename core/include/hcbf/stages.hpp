// The stages of a cascade, on polygons: each chooses from the inputs that the stages before leave,
// `Workspace::feasible`, or narrows them.
#pragma once
#include <hcbf/soft_minimum.hpp>

namespace hcbf::stages {

using namespace program_records;
using polygon::Corners;

// Keeps the inputs that meet the rows or, where none does, violate them least (min sum delta^2).
template <class Number>
void meet(RowsOf<Number> rows, WorkspaceOf<Number>& w) {
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
template <class Number>
PointOf<Number> relax(const CostOf<Number>& cost, WorkspaceOf<Number>& w) {
  if (cost.lambda_u > 0.0) return soft_minimum::soft_minimum(w.feasible, cost, w);
  w.trial.corners = w.feasible.corners;
  soft_minimum::keep_least(w.trial, cost, w);
  return polygon::nearest<Number>(w.trial, cost.u_nominal);
}

// Returns argmin lambda_u |u - u*|^2 + sum lambda_k (t_k - a_k u)^2 with the rows' targets t_k.
//
// For lambda_u = 0 steep rows come first where flat ones would drown in their rounding, as in
// `soft_minimum::keep_least`.
template <class Number>
PointOf<Number> draw(const CostOf<Number>& cost, WorkspaceOf<Number>& w) {
  const auto minimum = [&](const PolygonOf<Number>& polygon) {
    auto problem = polygon::LeastSquaresOf<Number>::distance(cost.lambda_u, cost.u_nominal);
    for (const RowOf<Number>& row : cost.rows) {
      const Number root = sqrt(row.weight);
      problem.add(root * row.a.x, root * row.a.y, root * row.target);
    }
    return polygon::minimise(polygon, problem, cost.u_nominal, w.radius, w.chord);
  };
  PointOf<Number> u = minimum(w.feasible);
  if (cost.lambda_u > 0.0) return u;
  w.trial.corners = w.feasible.corners;
  while (const double floor = soft_minimum::flattest_that_counts(cost.rows)) {
    for (const RowOf<Number>& row : cost.rows)
      if (sqrt(row.weight) * row.norm >= floor && !w.trial.is_point())
        polygon::slice_at(w.trial, row.through(u), w.radius);
    soft_minimum::drop(cost.rows, floor);
    u = minimum(w.trial);
  }
  return u;
}

// Writes a_k u_k of each row that is not strict, u_k its own program's solution over U.
template <class Number>
void set_targets(Corners<Number> vertices, RowsOf<Number> rows, const PointOf<Number>& u_nominal,
                 WorkspaceOf<Number>& w) {
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

// Keeps the inputs at which each row has the value that it has at u.
template <class Number>
void pin(RowsOf<Number> rows, const PointOf<Number>& u, WorkspaceOf<Number>& w) {
  for (const RowOf<Number>& row : rows)
    if (row.steers() && !w.feasible.is_point()) polygon::slice_at(w.feasible, row.through(u), w.radius);
}

// Keeps the inputs at which no row is violated more than at u.
template <class Number>
void bound(RowsOf<Number> rows, const PointOf<Number>& u, WorkspaceOf<Number>& w) {
  for (const RowOf<Number>& row : rows) {
    if (!row.steers()) continue;
    const LineOf<Number> line = row.line(row.b);
    polygon::cut(w.feasible, {line.n, min(line.d, polygon::dot(line.n, u))}, w.radius);
  }
}

}  // namespace hcbf::stages
