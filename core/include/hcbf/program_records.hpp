// What the cascade is made of: settings, rows, the cost of a stage, working space.
#pragma once
#include <algorithm>
#include <vector>

#include <hcbf/layout.hpp>
#include <hcbf/arrays.hpp>
#include <hcbf/polygon.hpp>

namespace hcbf::program_records {

using namespace functions;
using polygon::LineOf, polygon::Point, polygon::PointOf, polygon::PolygonOf;

// What the rows that are not strict pay for; as numbers, what NumPy records hold.
enum class Lower : Index { NOTHING, RELAXED, DRAWN };
// What a level locks.
enum class Lock : Index { NOTHING, PIN, BOUND };

// A program: its plan, its prices and U. K is 1, or N for N states with a U or weights of their own.
struct Settings {
  Lower lower;
  bool by_level;  // whether each priority is a stage; if not there are two, strict rows and others
  Lock lock;
  bool ranks;     // whether rows of priority 1 come before the others
  bool guided;    // whether guidance may add a row of the last rank, which costs the others nothing
  double radius;  // the largest norm of an input in U
  double lambda_u;
  bool known_offset;             // whether the least slack comes from alpha2(psi); 0 if not
  Cube<const double> vertices;   // (K, V, 2) the corners of U, counter-clockwise
  Matrix<const double> weights;  // (K, 1 + L) see `weights`
};

// What a state may have for itself.
struct Own {
  Matrix<const double> vertices;  // (V, 2)
  Vector<const double> weights;   // (1 + L,)
};

// Returns what state i of N has.
inline Own own_of(const Settings& settings, Index i) {
  return {settings.vertices[settings.vertices.layers > 1 ? i : 0],
          settings.weights[settings.weights.rows > 1 ? i : 0]};
}

// What is known of a row on the cell of a search: nothing yet, that it is paid for, that it is not.
enum class State { OPEN, PAID, MET };

// What the stages read of a row, for any number of inputs.
template <class Number>
struct TermsOf {
  Index index;    // where it stood before rows were sorted by stage
  Number norm;    // |a|
  Number b;       // bound, a u >= b
  bool strict;    // whether the stage meets the row, instead of paying for it
  Number weight;  // lambda(h); 1 for a strict row
  Number least;   // the least slack; 0 for a strict row
  Number target;  // a u_k, u_k the solution of the row's own program

  // Whether it is more than a constant.
  bool steers() const { return norm > tolerances::ZERO_GRADIENT; }
};
using Terms = TermsOf<double>;

// A row of two inputs.
template <class Number>
struct RowOf : TermsOf<Number> {
  using TermsOf<Number>::norm, TermsOf<Number>::b, TermsOf<Number>::least;
  PointOf<Number> a;  // gradient
  State state;        // of `soft_minimum`

  Number value(const PointOf<Number>& u) const { return polygon::dot(a, u); }
  // The violation, and its excess over the least slack.
  Number lack(const PointOf<Number>& u) const { return b - a.x * u.x - a.y * u.y; }
  Number excess(const PointOf<Number>& u) const { return b - least - a.x * u.x - a.y * u.y; }
  // Its line a u = bound, if it steers.
  LineOf<Number> line(const Number& bound) const { return {{a.x / norm, a.y / norm}, bound / norm}; }
  // Its line through a point.
  LineOf<Number> through(const PointOf<Number>& u) const {
    const PointOf<Number> n{a.x / norm, a.y / norm};
    return {n, polygon::dot(n, u)};
  }
};

template <class Number>
using RowsOf = Vector<RowOf<Number>>;
using Row = RowOf<double>;

// lambda_u |u - u*|^2 + sum w_k max(m_k, b_k - a_k u)^2 over the rows of one stage.
template <class Number>
struct CostOf {
  RowsOf<Number> rows;
  double lambda_u;
  PointOf<Number> u_nominal;
};
using Cost = CostOf<double>;

// What the stages write to; made once for a whole batch, or for a scene.
template <class Number>
struct WorkspaceOf {
  double radius = 0.0;                   // the largest norm of an input, which sets the scale of rounding
  PolygonOf<Number> feasible;            // the inputs that the stages so far leave
  PolygonOf<Number> trial, cell, chord;  // what stages, `soft_minimum` and `minimise` cut
  std::vector<RowOf<Number>> rows;       // (m,) sorted by stage
  std::vector<Index> start;              // where each stage's rows start, as far as there are stages

  // Makes room for a U with so many corners, and m rows.
  void grow(double new_radius, Index corners, Index m) {
    radius = new_radius;
    for (PolygonOf<Number>* each : {&feasible, &trial, &cell, &chord}) each->reserve(corners + m + 4);
    rows.resize(std::max<Index>(m, rows.size()));
    const Index ranks = std::max(m, layout::LOWEST_RANK) + 4;  // guidance may be below the lowest
    start.resize(std::max<Index>(ranks, start.size()));
  }
};
using Workspace = WorkspaceOf<double>;

inline Workspace make_workspace(double radius, Index corners, Index m) {
  Workspace w;
  w.grow(radius, corners, m);
  return w;
}

}  // namespace hcbf::program_records
