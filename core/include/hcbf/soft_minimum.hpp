// The minimum over a polygon of one-sided penalties, lambda_u |u - u*|^2 + sum w_k max(m_k, v_k)^2.
//
// v_k = b_k - a_k u is row k's violation, m_k >= 0 the least slack it pays for. The cost is convex
// and quadratic on each cell that the kinks v_k = m_k cut out of the polygon. Mostly a guess of the
// cell is right after a few rounds. If not, the minimum on a kink shows on which side of it the
// minimum of the whole is (`kink`): the polygon is cut down, kink by kink, to one cell.
#pragma once
#include <optional>

#include <hcbf/kink.hpp>

namespace hcbf::soft_minimum {

using namespace program_records;
using polygon::LeastSquaresOf;

// Returns the quadratic of the rows that pay.
template <class Number>
LeastSquaresOf<Number> paid(const CostOf<Number>& cost) {
  auto problem = LeastSquaresOf<Number>::distance(cost.lambda_u, cost.u_nominal);
  for (const RowOf<Number>& row : cost.rows) {
    if (row.state != State::PAID) continue;
    const Number root = sqrt(row.weight);
    problem.add(root * row.a.x, root * row.a.y, root * row.b);
  }
  return problem;
}

// Notes which rows pay at a point; returns whether they are those of the guess before.
template <class Number>
bool confirms(const CostOf<Number>& cost, const PointOf<Number>& u, double radius) {
  bool same = true;
  for (RowOf<Number>& row : cost.rows) {
    if (row.weight == 0.0 || !row.steers()) {
      row.state = State::MET;
      continue;
    }
    const Number lack = row.lack(u);
    same &= row.state == State::PAID ? lack >= tolerances::SURELY_PAID * row.norm * radius
                                     : lack <= tolerances::SURELY_MET * (abs(row.b) + row.norm * radius);
    row.state = lack > 0.0 ? State::PAID : State::MET;
  }
  return same;
}

// Guesses which rows pay, minimises with those, and tries again with those that then do.
//
// Without least slacks the cost has a continuous gradient: a point that minimises the quadratic of
// just the rows that it violates minimises the whole.
template <class Number>
std::optional<PointOf<Number>> guess(const PolygonOf<Number>& polygon, const CostOf<Number>& cost,
                                     WorkspaceOf<Number>& w) {
  for (const RowOf<Number>& row : cost.rows)
    if (row.least != 0.0) return std::nullopt;
  PointOf<Number> u = polygon.corners[0];
  const double count = static_cast<double>(polygon.corners.size());
  for (std::size_t i = 1; i < polygon.corners.size(); ++i)
    u = {u.x + polygon.corners[i].x, u.y + polygon.corners[i].y};
  u = {u.x / count, u.y / count};
  for (int attempt = 0; attempt < 8; ++attempt) {
    if (confirms(cost, u, w.radius) && attempt > 0) return u;
    u = polygon::minimise(polygon, paid(cost), cost.u_nominal, w.radius, w.chord);
  }
  return std::nullopt;
}

// Returns the open row whose kink halves the cell best, -1 if none crosses it. Rows whose kinks pass
// the cell by are noted as met or paid.
template <class Number>
Index halving_kink(const PolygonOf<Number>& cell, const CostOf<Number>& cost, double thin) {
  Index chosen = -1;
  Number depth = 0.0;
  for (Index k = 0; k < cost.rows.size; ++k) {
    RowOf<Number>& row = cost.rows[k];
    if (row.state != State::OPEN) continue;
    const LineOf<Number> line = row.line(row.b - row.least);
    const auto [lowest, highest] = polygon::span(cell, line.n);
    const Number halves = min(line.d - lowest, highest - line.d);
    if (lowest >= line.d - thin)
      row.state = State::MET;
    else if (highest <= line.d + thin)
      row.state = State::PAID;
    else if (halves > depth)
      chosen = k, depth = halves;
  }
  return chosen;
}

// Returns a minimiser over the polygon; rows of weight 0 drop out. Where lambda_u is 0 it need not be
// the one nearest u*. The cell, the chord and the rows' states are written to.
template <class Number>
PointOf<Number> soft_minimum(const PolygonOf<Number>& polygon, const CostOf<Number>& cost,
                             WorkspaceOf<Number>& w) {
  if (const auto found = guess(polygon, cost, w)) return *found;
  w.cell.corners = polygon.corners;
  for (RowOf<Number>& row : cost.rows)
    row.state = row.weight != 0.0 && row.steers() ? State::OPEN : State::MET;
  while (true) {
    const Index k = halving_kink(w.cell, cost, tolerances::THIN * w.radius);
    if (k < 0) return polygon::minimise(w.cell, paid(cost), cost.u_nominal, w.radius, w.chord);
    RowOf<Number>& row = cost.rows[k];
    const LineOf<Number> line = row.line(row.b - row.least);
    const auto [u, side] = kink::settle(w.cell, line, k, cost, w.radius);
    if (side == 0) return u;
    row.state = side > 0 ? State::MET : State::PAID;
    polygon::cut(w.cell, side > 0 ? line : -line, w.radius);
  }
}

// Returns the steepness sqrt(w_k) |a_k| below which rows are too flat beside the steepest, 0 for none.
template <class Number>
double flattest_that_counts(RowsOf<Number> rows) {
  double steepest = 0.0, flattest = INFINITY;
  for (const RowOf<Number>& row : rows) {
    if (!(row.weight > 0.0 && row.steers())) continue;
    const double steepness = value_of(sqrt(row.weight) * row.norm);
    steepest = max(steepest, steepness), flattest = min(flattest, steepness);
  }
  return steepest > tolerances::GRADED * flattest ? steepest / tolerances::GRADED : 0.0;
}

// Gives the rows that are not flatter weight 0; returns whether rows are left, for 0 false.
template <class Number>
bool drop(RowsOf<Number> rows, double floor) {
  if (floor == 0.0) return false;
  for (RowOf<Number>& row : rows)
    if (sqrt(row.weight) * row.norm >= floor) row.weight = 0.0;
  return true;
}

// Cuts a polygon to the inputs at which rows pay what they pay at u, a minimiser of
// sum w_k max(m_k, v_k)^2: each violation above m_k has one value on all minimisers. Rows whose
// steepness is below `floor` are passed over.
template <class Number>
void lock(PolygonOf<Number>& polygon, const CostOf<Number>& cost, const PointOf<Number>& u, double floor,
          double radius) {
  Number total = 0.0;
  for (const RowOf<Number>& row : cost.rows) {
    const Number excess = max(0.0, row.excess(u));
    total += row.weight * excess * excess;
  }
  const Number negligible = tolerances::NEGLIGIBLE * sqrt(total);
  for (const RowOf<Number>& row : cost.rows) {
    const Number root = sqrt(row.weight);
    if (root == 0.0 || !row.steers() || root * row.norm < floor) continue;
    const LineOf<Number> line = row.line(row.b - row.least);
    const Number here = polygon::dot(line.n, u), excess = row.norm * (line.d - here);
    if (here < line.d - tolerances::THIN * radius && root * excess > negligible)
      polygon::slice_at(polygon, {line.n, here}, radius);
    else
      polygon::cut(polygon, {line.n, min(here, line.d)}, radius);
  }
}

// Cuts a polygon to the minimisers of sum w_k max(m_k, v_k)^2, and returns one.
//
// Where rows differ so much in steepness that the squares of the flat ones drown in the rounding of
// the steep ones, the steep ones are locked at the minimum of all, and the flat ones decide among
// the inputs that are left. Rows that were locked so have weight 0 afterwards.
template <class Number>
PointOf<Number> keep_least(PolygonOf<Number>& polygon, const CostOf<Number>& cost, WorkspaceOf<Number>& w) {
  while (true) {
    const PointOf<Number> u = soft_minimum(polygon, cost, w);
    const double floor = flattest_that_counts(cost.rows);
    lock(polygon, cost, u, floor, w.radius);
    if (!drop(cost.rows, floor)) return u;
  }
}

}  // namespace hcbf::soft_minimum
