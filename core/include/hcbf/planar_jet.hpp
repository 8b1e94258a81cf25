// What a shape is at a point: the signed distance H with its derivatives, and its core.
#pragma once
#include <array>
#include <cmath>

#include <hcbf/layout.hpp>

namespace hcbf {

using Pair = std::array<double, 2>;

constexpr double INF = INFINITY;

// The signed distance H of a shape, so that ‖∇H‖ = 1, and its derivatives. The Hessian has rank one,
// ∇²H = t tᵀ / d: d is the distance from the centre of curvature (a disc's centre, a polygon's
// corner), and infinite where H is flat.
template <class Number>
struct PlanarJetOf {
  Number h;         // H [m]
  Number gx, gy;    // ∇H
  Number distance;  // d [m]
  Number tx, ty;    // t
};
using PlanarJet = PlanarJetOf<double>;

// The convex set from which a barrier is a distance, h = distance − radius, seen locally.
template <class Number>
struct CoreOf {
  Number distance;  // from the core [m]; infinite where ∇H does not turn within the reach
  Number radius;    // how far the region reaches beyond its core [m]
  bool is_point;    // whether the core is a point, from all of the reach
};
using Core = CoreOf<double>;

struct Bounds {  // of a region [m]; infinite with swapped signs where it has none
  double low_x = INF, low_y = INF, high_x = -INF, high_y = -INF;
};

constexpr double TINY = 1e-9;  // below this distance from a region's centre its gradient is along +x [m]

// Clears a block (WIDTH,) and writes its velocity.
inline void begin_block(double* c, const Pair& velocity) {
  for (int i = 0; i < layout::WIDTH; ++i) c[i] = 0.0;
  c[layout::VELOCITY_X] = velocity[0], c[layout::VELOCITY_Y] = velocity[1];
}

}  // namespace hcbf
