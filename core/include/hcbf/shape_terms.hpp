// The built-in barriers: values and derivatives of N states at once. What moves is evaluated in its own
// frame: `jet` is the one place where a frame is moved and a shape looked up. A user's own barrier
// (`layout::CUSTOM`) is passed over: `BarrierSet` in Python fills it in.
#pragma once
#include <algorithm>

#include <hcbf/constants.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/pieces.hpp>
#include <hcbf/shapes.hpp>
#include <hcbf/zone.hpp>

namespace hcbf::shape_terms {

// Returns whether a barrier is a built-in shape.
inline bool is_region(Index kind) { return kind < layout::SPEED_LIMIT; }

// Returns whether a barrier is a class of a map.
inline bool is_mapped(Index kind) { return layout::MAPPED <= kind && kind <= layout::ZONES; }

// h of a region at a point of the world (x, y) and time t, ∇h, d and t; see `PlanarJet`.
inline PlanarJet jet(Index kind, const double* c, double x, double y, double t) {
  const auto [qx, qy] = shapes::in_frame(c, x, y, t);
  return shapes::jet(kind, c, qx, qy);
}

// h of a region at a point of the world; infinity for a user's own barrier.
inline double height(Index kind, const double* c, double x, double y, double t) {
  return jet(kind, c, x, y, t).h;
}

// h of a class of a map at a distance from its nearest piece and a velocity.
inline double of_map(Index kind, const double* c, double distance, double vx, double vy) {
  distance = std::min(distance, constants::FARTHEST);  // where there is no piece at all
  if (kind == layout::MAPPED) return distance;
  return zone::value(c[layout::V_MAX], std::max(0.0, distance - c[layout::KEPT]), vx, vy);
}

// h of one barrier at the state x (4,) and time t; infinity for a user's own. The atlas is empty where
// there is no map.
inline double value(Index kind, const double* c, Vector<const double> atlas, const double* x, double t) {
  if (kind == layout::SPEED_LIMIT) return speed_limit::value(c[layout::V_MAX], x[2], x[3]);
  if (atlas.size > 0 && is_mapped(kind)) {
    const Index at = static_cast<Index>(c[layout::PIECES]);
    return of_map(kind, c, pieces::nearest(atlas, at, x[0], x[1]).distance, x[2], x[3]);
  }
  return height(kind, c, x[0], x[1], t);
}

// Writes h (N, m) of N states x (N, 4) at the times t (N,), in N scenes or all in one: kind (N, m) or
// (1, m), parameters (N, m, WIDTH) or (1, m, WIDTH).
inline void values(Matrix<const Index> kind, Cube<const double> parameters, Vector<const double> atlas,
                   Matrix<const double> x, Vector<const double> t, Matrix<double> h) {
  for (Index i = 0; i < x.rows; ++i) {
    const Index n = kind.rows > 1 ? i : 0;
    for (Index k = 0; k < kind.columns; ++k)
      h(i, k) = value(kind(n, k), parameters[n][k].data, atlas, x[i].data, t[i]);
  }
}

// Writes h (N, m) and what a policy sees of each barrier, (N, m, 4): h, unit ∇h, ∂h/∂t. Each scene has
// its state. Three zeros follow h of what is no region.
inline void sense(Matrix<const Index> kind, Cube<const double> parameters, Vector<const double> atlas,
                  Matrix<const double> x, Vector<const double> t, Matrix<double> h, Cube<double> sensed) {
  for (Index i = 0; i < x.rows; ++i)
    for (Index k = 0; k < kind.columns; ++k) {
      const double* c = parameters[i][k].data;
      double* seen = sensed[i][k].data;
      seen[1] = seen[2] = seen[3] = 0.0;
      if (atlas.size > 0 && kind(i, k) == layout::MAPPED) {
        const Index at = static_cast<Index>(c[layout::PIECES]);
        const auto slope = pieces::jet(atlas, at, x(i, 0), x(i, 1));
        h(i, k) = slope.h, seen[1] = slope.gx, seen[2] = slope.gy;
      } else if (is_region(kind(i, k))) {
        const PlanarJet there = jet(kind(i, k), c, x(i, 0), x(i, 1), t[i]);
        const double norm = std::sqrt(there.gx * there.gx + there.gy * there.gy);
        h(i, k) = there.h;
        seen[1] = there.gx / norm, seen[2] = there.gy / norm;
        seen[3] = -(there.gx * c[layout::VELOCITY_X] + there.gy * c[layout::VELOCITY_Y]);
      } else {
        h(i, k) = value(kind(i, k), c, atlas, x[i].data, t[i]);
      }
      seen[0] = h(i, k);
    }
}

}  // namespace hcbf::shape_terms
