// The built-in shapes, and how the functions of one are found by its kind. A new shape is a header with
// `CODE`, `jet`, `core` and `bounds`, and a line in each function here.
#pragma once
#include <hcbf/capsule.hpp>
#include <hcbf/convex_polygon.hpp>
#include <hcbf/disc.hpp>
#include <hcbf/ellipse.hpp>
#include <hcbf/half_plane.hpp>

namespace hcbf::shapes {

template <class Number>
struct PlaceOf {
  Number x, y;
};
using Place = PlaceOf<double>;

// A point of the world (x, y) as the barrier's frame sees it at time t.
template <class Number>
PlaceOf<Number> in_frame(const Number* c, const Number& x, const Number& y, double t) {
  return {x - c[layout::VELOCITY_X] * t, y - c[layout::VELOCITY_Y] * t};
}

// H and its derivatives at a point of the shape's frame; H is infinite for what is no shape.
template <class Number>
inline PlanarJetOf<Number> jet(Index kind, const Number* c, const Number& x, const Number& y) {
  switch (kind) {
    case half_plane::CODE: return half_plane::jet(c, x, y);
    case disc::CODE: return disc::jet(c, x, y);
    case ellipse::CODE: return ellipse::jet(c, x, y);
    case convex_polygon::CODE: return convex_polygon::jet(c, x, y);
    case capsule::CODE: return capsule::jet(c, x, y);
  }
  return {INF, 0.0, 0.0, INF, 0.0, 0.0};
}

// The core of a shape seen from a point of its frame (x, y), where H and d are `h` and `distance` [m],
// by a robot that gets `reach` far in one period [m].
template <class Number>
inline CoreOf<Number> core(Index kind, const Number* c, const Number& x, const Number& y, const Number& h,
                    const Number& distance, const Number& reach) {
  switch (kind) {
    case half_plane::CODE: return half_plane::core(c, x, y, h, distance, reach);
    case disc::CODE: return disc::core(c, x, y, h, distance, reach);
    case ellipse::CODE: return ellipse::core(c, x, y, h, distance, reach);
    case convex_polygon::CODE: return convex_polygon::core(c, x, y, h, distance, reach);
    case capsule::CODE: return capsule::core(c, x, y, h, distance, reach);
  }
  return {INF, INF, false};
}

// Of a region at time 0 [m].
inline Bounds bounds(Index kind, const double* c) {
  switch (kind) {
    case disc::CODE: return disc::bounds(c);
    case ellipse::CODE: return ellipse::bounds(c);
    case convex_polygon::CODE: return convex_polygon::bounds(c);
    case capsule::CODE: return capsule::bounds(c);
  }
  return half_plane::bounds(c);
}

}  // namespace hcbf::shapes
