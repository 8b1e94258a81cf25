// N double integrators in N scenes, advanced together by one control step.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/mapped.hpp>
#include <hcbf/reduced_order.hpp>
#include <hcbf/shape_terms.hpp>
#include <hcbf/task.hpp>

namespace hcbf::regions_batch {

struct References {  // at the control times
  Cube<const double> tables;  // (k, T, 6) position [m], velocity [m/s] and acceleration [m/s²]
  Vector<const Index> of;     // (N,) which table each robot follows
  Vector<const Index> last;   // (N,) that table's last row, which stays when the reference has ended

  // What robot `i` follows at a control step, (6,).
  const double* at(Index i, Index step) const { return tables[of[i]][std::min(step, last[i])].data; }
};

// ‖p_ref − p‖ [m].
inline double distance(const double* reference, const double* x) {
  return std::hypot(reference[0] - x[0], reference[1] - x[1]);
}

// Writes the observations (N, 8 + 4 m) and ‖p_ref − p‖ (N,). `sensed` (N, ≥ m, 4): what a policy sees.
inline void observe(const References& references, Matrix<const double> x, Vector<const Index> steps,
                    Cube<const double> sensed, Matrix<double> seen, Vector<double> error) {
  for (Index i = 0; i < x.rows; ++i) {
    const double* now = references.at(i, steps[i]);
    error[i] = distance(now, x[i].data);
    task::write_observation(x[i].data, now, sensed[i], seen[i]);
  }
}

// The least h of a region at the points of `way` (k, 4) and their times. h is convex: its tangent at one
// point is a lower bound at the others, most of which are then not looked at.
inline double least_along(Index kind, const double* c, Matrix<const double> way, const double* times) {
  constexpr double EXACT = 1e-8;  // a tangent is at least so exact, at a centre, too [m]
  double least = INF;
  PlanarJet at{INF, 0.0, 0.0, INF, 0.0, 0.0};  // there
  shapes::Place of{0.0, 0.0};
  for (Index n = 0; n < way.rows; ++n) {
    const Index s = n > 0 ? n - 1 : way.rows - 1;
    const auto q = shapes::in_frame(c, way(s, 0), way(s, 1), times[s]);
    if (at.h + at.gx * (q.x - of.x) + at.gy * (q.y - of.y) > least + EXACT) continue;
    const PlanarJet here = shapes::jet(kind, c, q.x, q.y);
    if (here.h < least) least = here.h, at = here, of = q;
  }
  return least;
}

// Advances x (N, 4) over one control step under u (N, 2), its speed capped at v_max (N,); writes the
// least h (N, m) on the way, and ‖p_ref − p‖ (N,) before it. `steps` (N,): control steps since the reset.
inline void advance(Matrix<const Index> kind, Cube<const double> parameters, Vector<const double> atlas,
                    const References& references, Matrix<double> x, Vector<const Index> steps,
                    Matrix<const double> u, Vector<const double> v_max, Matrix<double> min_h,
                    Vector<double> before) {
  constexpr Index count = task::SUBSTEPS;
  double way[count][4], times[count], room[count];
  for (Index i = 0; i < x.rows; ++i) {
    double* state = x[i].data;
    const double* fastest = way[0];
    double most = -1.0;  // its squared speed
    before[i] = distance(references.at(i, steps[i]), state);
    for (Index s = 0; s < count; ++s) {
      const auto next = reduced_order::double_integrator_step(x[i], u[i], task::PHYSICS_DT, v_max[i]);
      std::copy_n(next.data(), 4, state);
      std::copy_n(state, 4, way[s]);
      times[s] = steps[i] * task::CONTROL_DT + (s + 1) * task::PHYSICS_DT;
      const double speed2 = state[2] * state[2] + state[3] * state[3];
      if (speed2 > most) most = speed2, fastest = way[s];
    }
    const Matrix<const double> path{way[0], count, 4};
    for (Index k = 0; k < kind.columns; ++k) {
      const Index which = kind(i, k);
      const double* c = parameters[i][k].data;
      if (which == layout::SPEED_LIMIT)
        min_h(i, k) = speed_limit::value(c[layout::V_MAX], fastest[2], fastest[3]);
      else if (atlas.size > 0 && shape_terms::is_mapped(which))
        min_h(i, k) = mapped::least_along(which, c, atlas, path, {room, count});
      else
        min_h(i, k) = least_along(which, c, path, times);
    }
  }
}

}  // namespace hcbf::regions_batch
