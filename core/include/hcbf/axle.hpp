// A differential drive: an axle p that rolls along its heading e, and the point p + ℓ e before it, which
// moves in any direction and follows the reduced-order model, p'' = u. Over a period T an input changes
// what the robot is commanded by v += T e·u and ω += (T/ℓ) e⊥·u.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::axle {

constexpr double SPIN_UP = 0.25;     // in which the turning rate reaches its greatest at the soonest [s]
constexpr double LEAST_ROOM = 0.1;   // share of the greatest acceleration that a passed limit leaves open

struct Axle {
  double look_ahead;  // ℓ [m]
  double forward;     // greatest speed ahead and back [m/s]
  double turn;        // greatest turning rate [rad/s]
  double braking;     // greatest acceleration along the heading [m/s²]
};

// The greatest acceleration of the point across the heading [m/s²].
inline double across(const Axle& axle) {
  return std::min(axle.braking, axle.look_ahead * axle.turn / SPIN_UP);
}

struct Speeds {
  double forward, turning;  // v [m/s], ω [rad/s]
};

// v and ω of the point's state x (4,).
inline Speeds speeds(const Axle& axle, const double* x, double heading) {
  const double cos = std::cos(heading), sin = std::sin(heading);
  return {cos * x[2] + sin * x[3], (cos * x[3] - sin * x[2]) / axle.look_ahead};
}

// Position and velocity (4,) of the axle whose point has the state x (4,).
inline void place(const Axle& axle, const double* x, double heading, double* out) {
  const double cos = std::cos(heading), sin = std::sin(heading), v = cos * x[2] + sin * x[3];
  const double px = x[0] - axle.look_ahead * cos, py = x[1] - axle.look_ahead * sin;
  out[0] = px, out[1] = py, out[2] = v * cos, out[3] = v * sin;
}

struct Room {
  double least, greatest;  // accelerations [m/s²]
};

// The accelerations that retain ±most one period later.
inline Room room(double hardest, double now, double most, double period) {
  double low = -hardest, high = hardest;
  if (period > 0.0) {
    low = std::max(low, (-most - now) / period);
    high = std::min(high, (most - now) / period);
  }
  const double open = LEAST_ROOM * hardest;
  return {std::min(low, hardest - open), std::max(high, open - hardest)};
}

// The corners (4, 2) of U at one state, counter-clockwise [m/s²]; a period of 0 is not known.
inline void corners(const Axle& axle, const double* x, double heading, double period, double* out) {
  const Speeds now = speeds(axle, x, heading);
  const double cos = std::cos(heading), sin = std::sin(heading), length = axle.look_ahead;
  const Room ahead = room(axle.braking, now.forward, axle.forward, period);
  const Room aside = room(across(axle), length * now.turning, length * axle.turn, period);
  for (int k = 0; k < 4; ++k) {
    const double along = k == 0 || k == 3 ? ahead.least : ahead.greatest;
    const double side = k < 2 ? aside.least : aside.greatest;
    out[2 * k] = cos * along - sin * side, out[2 * k + 1] = sin * along + cos * side;
  }
}

}  // namespace hcbf::axle
