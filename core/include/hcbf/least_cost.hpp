// The least cost of relaxed rows in one or two free directions, for the general programs.
#pragma once
#include <hcbf/stages.hpp>

namespace hcbf::least_cost {

using namespace program_records;

// Returns a minimiser z of sum w_k delta_k^2 over rows z >= lower.
//
// soft: (s, 5) of each relaxed row a, t_k, w_k and the least delta_k; one_sided: whether
// a_k z + delta_k >= t_k, equal if not. rows: (k, 2), of norms from 1/2 to 1, of a nonempty set of
// diameter 2 `radius` at most; lower: (k,) their bounds. radius: the largest norm of an input.
inline Point least_cost(Matrix<const double> soft, bool one_sided, Matrix<const double> rows,
                        Vector<const double> lower, double radius) {
  Workspace w = make_workspace(radius, 4 + lower.size, soft.rows);
  const double size = 4.0 * radius;
  w.feasible.corners = {{-size, -size}, {size, -size}, {size, size}, {-size, size}};
  for (Index k = 0; k < lower.size; ++k)
    polygon::cut(w.feasible, {{rows(k, 0), rows(k, 1)}, lower[k]}, radius);
  for (Index k = 0; k < soft.rows; ++k) {
    Row& row = w.rows[k];
    row.a = {soft(k, 0), soft(k, 1)};
    row.b = row.target = soft(k, 2);
    row.norm = std::hypot(row.a.x, row.a.y);
    row.weight = soft(k, 3), row.least = soft(k, 4);
  }
  const Cost cost{{w.rows.data(), soft.rows}, 0.0, {0.0, 0.0}};
  return one_sided ? soft_minimum::keep_least(w.feasible, cost, w) : stages::draw(cost, w);
}

}  // namespace hcbf::least_cost
