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
using polygon::abs, polygon::LeastSquares, polygon::max, polygon::min;

// Returns the quadratic of the rows that pay.
inline LeastSquares paid(const Cost& cost) {
  auto problem = LeastSquares::distance(cost.lambda_u, cost.u_nominal);
  for (const Row& row : cost.rows) {
    if (row.state != State::PAID) continue;
    const double root = std::sqrt(row.weight);
    problem.add(root * row.a.x, root * row.a.y, root * row.b);
  }
  return problem;
}

// Notes which rows pay at a point; returns whether they are those of the guess before.
inline bool confirms(const Cost& cost, Point u, double radius) {
  bool same = true;
  for (Row& row : cost.rows) {
    if (row.weight == 0.0 || !row.steers()) {
      row.state = State::MET;
      continue;
    }
    const double lack = row.lack(u);
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
inline std::optional<Point> guess(const Polygon& polygon, const Cost& cost, Workspace& w) {
  for (const Row& row : cost.rows)
    if (row.least != 0.0) return std::nullopt;
  Point u = polygon.corners[0];
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
inline Index halving_kink(const Polygon& cell, const Cost& cost, double thin) {
  Index chosen = -1;
  double depth = 0.0;
  for (Index k = 0; k < cost.rows.size; ++k) {
    Row& row = cost.rows[k];
    if (row.state != State::OPEN) continue;
    const Line line = row.line(row.b - row.least);
    const auto [lowest, highest] = polygon::span(cell, line.n);
    const double halves = min(line.d - lowest, highest - line.d);
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
inline Point soft_minimum(const Polygon& polygon, const Cost& cost, Workspace& w) {
  if (const auto found = guess(polygon, cost, w)) return *found;
  w.cell.corners = polygon.corners;
  for (Row& row : cost.rows) row.state = row.weight != 0.0 && row.steers() ? State::OPEN : State::MET;
  while (true) {
    const Index k = halving_kink(w.cell, cost, tolerances::THIN * w.radius);
    if (k < 0) return polygon::minimise(w.cell, paid(cost), cost.u_nominal, w.radius, w.chord);
    Row& row = cost.rows[k];
    const Line line = row.line(row.b - row.least);
    const auto [u, side] = kink::settle(w.cell, line, k, cost, w.radius);
    if (side == 0) return u;
    row.state = side > 0 ? State::MET : State::PAID;
    polygon::cut(w.cell, side > 0 ? line : -line, w.radius);
  }
}

// Returns the steepness sqrt(w_k) |a_k| below which rows are too flat beside the steepest, 0 for none.
inline double flattest_that_counts(Rows rows) {
  double steepest = 0.0, flattest = INFINITY;
  for (const Row& row : rows) {
    if (!(row.weight > 0.0 && row.steers())) continue;
    const double steepness = std::sqrt(row.weight) * row.norm;
    steepest = max(steepest, steepness), flattest = min(flattest, steepness);
  }
  return steepest > tolerances::GRADED * flattest ? steepest / tolerances::GRADED : 0.0;
}

// Gives the rows that are not flatter weight 0; returns whether rows are left, for 0 false.
inline bool drop(Rows rows, double floor) {
  if (floor == 0.0) return false;
  for (Row& row : rows)
    if (std::sqrt(row.weight) * row.norm >= floor) row.weight = 0.0;
  return true;
}

// Cuts a polygon to the inputs at which rows pay what they pay at u, a minimiser of
// sum w_k max(m_k, v_k)^2: each violation above m_k has one value on all minimisers. Rows whose
// steepness is below `floor` are passed over.
inline void lock(Polygon& polygon, const Cost& cost, Point u, double floor, double radius) {
  double total = 0.0;
  for (const Row& row : cost.rows) {
    const double excess = max(0.0, row.excess(u));
    total += row.weight * excess * excess;
  }
  const double negligible = tolerances::NEGLIGIBLE * std::sqrt(total);
  for (const Row& row : cost.rows) {
    const double root = std::sqrt(row.weight);
    if (root == 0.0 || !row.steers() || root * row.norm < floor) continue;
    const Line line = row.line(row.b - row.least);
    const double here = polygon::dot(line.n, u), excess = row.norm * (line.d - here);
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
inline Point keep_least(Polygon& polygon, const Cost& cost, Workspace& w) {
  while (true) {
    const Point u = soft_minimum(polygon, cost, w);
    const double floor = flattest_that_counts(cost.rows);
    lock(polygon, cost, u, floor, w.radius);
    if (!drop(cost.rows, floor)) return u;
  }
}

}  // namespace hcbf::soft_minimum
