// The programs of any number of inputs, for one state; each stage is a projection on a polyhedron.
#pragma once
#include <hcbf/cascade.hpp>
#include <hcbf/polyhedron.hpp>

namespace hcbf::general_cascade {

using namespace program_records;
using program_records::StateRows, polyhedron::Doubles, polyhedron::Solver;

// A program: its plan and prices, whose vertices nobody reads, and U = {u : a u >= b}.
struct Program {
  Settings settings;
  Matrix<const double> a;
  Vector<const double> b;
};

// Returns whether u meets rows a u >= b.
inline bool meets(Matrix<const double> a, Vector<const double> b, const Doubles& u) {
  for (Index k = 0; k < b.size; ++k)
    if (free_inputs::dot(a[k], u.data()) < b[k]) return false;
  return true;
}

struct Answer {
  Index status, fallbacks;
};

// Filters u (n_u,), writing u, slack (m,) and delta (m,). `project` takes what rounding leaves outside U
// into it.
inline Answer filter_state(const Program& program, const StateRows& rows, Solver solver,
                           const std::function<void(Doubles&)>& project, Doubles& u, Vector<double> slack,
                           Vector<double> delta) {
  const Settings& settings = program.settings;
  const Index m = rows.b.size, n = u.size();
  if (meets(program.a, program.b, u) && meets(rows.a, rows.b, u)) {
    for (Index k = 0; k < m; ++k) slack[k] = 0.0, delta[k] = cascade::least_slack(settings, rows, k);
    return {program_records::NOMINAL, 0};
  }
  std::vector<polyhedron::Row> sorted(m);
  std::vector<Index> start(m + 4);
  const Index stage_count = cascade::sort(settings, settings.weights[0], rows.priority, sorted, start);
  for (polyhedron::Row& row : sorted) {
    cascade::load(settings, settings.weights[0], rows, row);
    row.a = rows.a[row.index];
    row.norm = free_inputs::norm_of(row.a);
  }
  const Doubles desired = u;
  polyhedron::Inputs inputs(program.a, program.b, settings.radius, {desired.data(), n}, settings.lambda_u,
                            std::move(solver));
  const Vector<polyhedron::Row> all{sorted.data(), m};
  u = cascade::decide(settings, all, start.data(), stage_count, inputs);
  project(u);
  double moved = 0.0;
  for (Index i = 0; i < n; ++i) moved = std::max(moved, std::abs(u[i] - desired[i]));
  const Index unpaid = moved > tolerances::NOMINAL * (1.0 + settings.radius) ? program_records::SAFE : program_records::NOMINAL;
  return {cascade::account(settings, unpaid, rows.priority, all, u, slack, delta), inputs.fallbacks};
}

}  // namespace hcbf::general_cascade
