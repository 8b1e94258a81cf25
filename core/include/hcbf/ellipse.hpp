// The outside of an ellipse: h is the signed distance to it.
//
// With u along the longer and v along the shorter axis, the normal at the foot of (u, v) is along
// w = (u / (s + a² − b²), v / s), where s > 0 solves (a w_u)² + (b w_v)² = 1; then H = (s − b²) ‖w‖.
// The reciprocal root of the left side is nearly linear and concave in s, so that Newton's steps come
// from below and are few.
#pragma once
#include <algorithm>

#include <hcbf/dual.hpp>
#include <hcbf/planar_jet.hpp>

namespace hcbf {

struct Ellipse {
  static constexpr Index CODE = 2;
  static constexpr const char* KIND = "ellipse";
  static constexpr int CENTER_X = 2, CENTER_Y = 3;  // [m]
  static constexpr int COS = 4, SIN = 5;            // the direction of the longer semi-axis
  static constexpr int LONGER = 6, SHORTER = 7;     // semi-axes [m]

  // How far from the longer axis a point is at least, so that its normal has a side [m].
  static constexpr double HAIR = 1e-13;
  static constexpr int MOST_STEPS = 20;  // Newton's, to the foot of a point; three to six are taken

  static Index write(double* c, const Pair& velocity, const Pair& center, const Pair& semi_axes,
                     double angle) {
    begin_block(c, velocity);
    c[CENTER_X] = center[0], c[CENTER_Y] = center[1];
    const double first = semi_axes[0], second = semi_axes[1], cos = std::cos(angle), sin = std::sin(angle);
    const bool turned = second > first;
    c[COS] = turned ? -sin : cos, c[SIN] = turned ? cos : sin;
    c[LONGER] = std::max(first, second), c[SHORTER] = std::min(first, second);
    return CODE;
  }

  template <class Number>
  [[gnu::noinline]] static PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
    using namespace functions;
    const Number dx = x - c[CENTER_X], dy = y - c[CENTER_Y];
    const Number a = c[LONGER], b = c[SHORTER], cos = c[COS], sin = c[SIN];
    const Number along = cos * dx + sin * dy, across = cos * dy - sin * dx;
    const Number u = abs(along), v = abs(across) + HAIR;
    const Number apart = a * a - b * b;
    Number s = max(b * v, a * u - apart);
    for (int k = 0; k < MOST_STEPS; ++k) {
      const Number wu = u / (s + apart), wv = v / s;
      const Number first = a * a * wu * wu, second = b * b * wv * wv, size = first + second;
      const Number step = size * (sqrt(size) - 1.0) / (first / (s + apart) + second / s);
      s += step;
      if (!(step > 1e-15 * s)) break;
    }
    const Number wu = u / (s + apart), wv = v / s, norm = sqrt(wu * wu + wv * wv);
    const Number h = (s - b * b) * norm;
    Number distance = a * a * b * b * norm * norm * norm + h;  // the radius of curvature at the foot, and h
    const Number nu = copysign(wu / norm, along), nv = copysign(wv / norm, across);
    const Number nx = cos * nu - sin * nv, ny = sin * nu + cos * nv;
    if (distance < TINY) distance = INF;
    return {h, nx, ny, distance, -ny, nx};
  }

  // The core is what a disc of the smallest radius of curvature, b²/a, leaves inside.
  template <class Number>
  static CoreOf<Number> core(const Number* c, const Number&, const Number&,
                             const PlanarJetOf<Number>& at, const Number&) {
    const Number radius = c[SHORTER] * c[SHORTER] / c[LONGER];
    return {at.h + radius, radius, false};
  }

  // Of the circle around the ellipse.
  static Bounds bounds(const double* c) {
    const double x = c[CENTER_X], y = c[CENTER_Y], longer = c[LONGER];
    return {x - longer, y - longer, x + longer, y + longer};
  }
};

}  // namespace hcbf
