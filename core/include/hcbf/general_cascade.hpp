// The programs of any number of inputs, for one state; each stage is a projection on a polyhedron.
#pragma once
#include <hcbf/cascade.hpp>
#include <hcbf/polyhedron.hpp>

namespace hcbf::general_cascade {

using namespace program_records;
using cbf_rows::StateRows, polyhedron::Doubles, polyhedron::Inputs, polyhedron::Solver;
using Rows = std::vector<polyhedron::Row>;

// A program: its plan and prices, whose vertices nobody reads, and U = {u : a u >= b}.
struct Program {
  Settings settings;
  Matrix<const double> a;
  Vector<const double> b;
};

// Returns whether u* is in U and meets every row.
inline bool allowed(const Program& program, Vector<const double> u_nominal, const StateRows& rows) {
  const auto meets = [&](Matrix<const double> a, Vector<const double> b) {
    for (Index k = 0; k < b.size; ++k) {
      double value = 0.0;
      for (Index i = 0; i < u_nominal.size; ++i) value += a(k, i) * u_nominal[i];
      if (value < b[k]) return false;
    }
    return true;
  };
  return meets(program.a, program.b) && meets(rows.a, rows.b);
}

struct Decision {
  Doubles u;       // empty where u* is allowed
  Doubles target;  // (m,) what rows that are not strict are drawn to
  Index fallbacks;
};

// Returns the rows sorted by stage, and how many stages there are.
inline Index staged(const Program& program, const StateRows& rows, Rows& sorted, std::vector<Index>& start) {
  const Vector<const double> weights = program.settings.weights[0];
  sorted.resize(rows.b.size), start.resize(rows.b.size + 4);
  const Index count = cascade::sort(program.settings, weights, rows.priority, sorted, start);
  for (polyhedron::Row& row : sorted) {
    cascade::load(program.settings, weights, rows, row);
    row.a = rows.a[row.index];
    row.norm = std::sqrt(polyhedron::dot(row.a, {row.a.begin(), row.a.end()}));
    row.target = row.b;
  }
  return count;
}

// Chooses an input; without a solver's name the core does.
inline Decision decide(const Program& program, Vector<const double> u_nominal, const StateRows& rows,
                       Solver solver) {
  if (allowed(program, u_nominal, rows)) return {{}, {}, 0};
  Rows sorted;
  std::vector<Index> start;
  const Index count = staged(program, rows, sorted, start);
  const Settings& settings = program.settings;
  Inputs inputs(program.a, program.b, settings.radius, u_nominal, settings.lambda_u, std::move(solver));
  const Vector<polyhedron::Row> all{sorted.data(), rows.b.size};
  Decision decision{cascade::decide(settings, all, start.data(), count, inputs), Doubles(rows.b.size), 0};
  for (const polyhedron::Row& row : sorted) decision.target[row.index] = row.target;
  decision.fallbacks = inputs.fallbacks;
  return decision;
}

// Writes slack (m,) and delta (m,) of the input u that came of a decision; returns the status.
inline Index account(const Program& program, Vector<const double> u_nominal, const StateRows& rows,
                     const Decision& decision, const Doubles& u, Vector<double> slack, Vector<double> delta) {
  const Settings& settings = program.settings;
  if (decision.u.empty()) {
    for (Index k = 0; k < slack.size; ++k) slack[k] = 0.0, delta[k] = cascade::least_slack(settings, rows, k);
    return result::NOMINAL;
  }
  Rows sorted;
  std::vector<Index> start;
  staged(program, rows, sorted, start);
  double moved = 0.0;
  for (Index i = 0; i < u_nominal.size; ++i) moved = std::max(moved, std::abs(u[i] - u_nominal[i]));
  for (polyhedron::Row& row : sorted) row.target = decision.target[row.index];
  const Index unpaid = moved > tolerances::NOMINAL * (1.0 + settings.radius) ? result::SAFE : result::NOMINAL;
  const Vector<polyhedron::Row> all{sorted.data(), rows.b.size};
  return cascade::account(settings, unpaid, rows.priority, all, u, slack, delta);
}

}  // namespace hcbf::general_cascade
