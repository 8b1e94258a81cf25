// What every shape computes at a point of its own frame. c is its block (WIDTH,), see `layout`.
#pragma once
#include <hcbf/dual.hpp>
#include <hcbf/layout.hpp>

namespace hcbf {

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
  double low_x, low_y, high_x, high_y;
};

constexpr double TINY = 1e-9;  // below this distance from a region's centre its gradient is along +x [m]

// ‖r‖ with its gradient, the distance ‖r‖ from the core, and the tangent.
template <class Number>
inline PlanarJetOf<Number> point_jet(const Number& x, const Number& y) {
  using namespace functions;
  const Number distance = sqrt(x * x + y * y);
  if (distance < TINY) return {distance, 1.0, 0.0, INF, 0.0, 1.0};
  const Number nx = x / distance, ny = y / distance;
  return {distance, nx, ny, distance, -ny, nx};
}

// Clears a block (WIDTH,) and writes its velocity.
inline void begin_block(double* c, const double* velocity) {
  for (int i = 0; i < layout::WIDTH; ++i) c[i] = 0.0;
  c[layout::VELOCITY_X] = velocity[0], c[layout::VELOCITY_Y] = velocity[1];
}

}  // namespace hcbf
