// Manoeuvres: feedback laws on the sampled state of a double integrator whose input is held for T.
//
// A built-in one steers to a velocity w for some samples, then to rest: u = P_U((w − v)/T), with P_U the
// nearest input of U. Then v⁺ − w = −T (d − P_U(d)), d = (w − v)/T, and d − P_U(d) brings no two d further
// apart. So two paths of one law differ in velocity by no more than at their start, and in position by that
// and the time times it: the lemma of docs/gatekeeper.md.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/plants.hpp>
#include <hcbf/polygon.hpp>

namespace hcbf::manoeuvres {

using gatekeeper::Law, polygon::Point;

constexpr Index MOST_PIECES = 1000;  // of a path; one that is longer counts as without rest
constexpr double STILL = 1e-6;       // slower than that a law of the user's is at rest [m/s]
constexpr double SIDEWAYS = 1e-12;   // below this share of ‖u‖² a corner of U is across u

// The user's laws: the input of one of them at a state (4,), `begun` samples after it began; NaN where it fails.
struct Own {
  Point (*input)(const void* context, Index which, const double* x, Index begun);
  const void* context;
};

struct Plant {
  Vector<const Point> corners;  // of U
  double period;                // T [s]
  Own own;
};

// A part of a path along which the input is constant.
struct Piece {
  Point u;
  double span;     // [s]
  bool lands;      // whether it ends at the velocity that the law steers to
  Index samples;   // how many periods
};

struct State {
  double x[4];
  double since;  // the next sample [s]; negative before it
};

// For how many samples u = P_U(d) stays the nearest input, while d falls by u from each to the next.
inline Index lasting(Vector<const Point> corners, const Point& d, const Point& u, Index most) {
  const double size = polygon::dot(u, u);
  double count = static_cast<double>(most);
  for (const Point& corner : corners) {
    const Point aside{corner.x - u.x, corner.y - u.y};
    const double along = polygon::dot(u, aside);
    if (along < -SIDEWAYS * size) count = std::min(count, polygon::dot(d, aside) / along);
  }
  return std::max<Index>(1, static_cast<Index>(count));
}

inline bool is_at_rest(const Law& law, const double* x) {
  if (law.own > 0) return law.begun > 0 && std::hypot(x[2], x[3]) <= STILL;
  return law.samples == 0 && x[2] == 0.0 && x[3] == 0.0;
}

// The next piece of a path from x (4,) on.
inline Piece next(const Plant& plant, const Law& law, const double* x) {
  if (law.own > 0) {
    const Point asked = plant.own.input(plant.own.context, law.own - 1, x, law.begun);
    const bool fails = !std::isfinite(asked.x + asked.y);
    return {fails ? asked : polygon::nearest<double>(plant.corners, asked), plant.period, false, 1};
  }
  const bool steers = law.samples > 0;
  const Index most = steers ? law.samples : MOST_PIECES;
  const Point d{((steers ? law.target[0] : 0.0) - x[2]) / plant.period,
                ((steers ? law.target[1] : 0.0) - x[3]) / plant.period};
  if (d.x == 0.0 && d.y == 0.0) return {d, plant.period * most, true, most};
  if (polygon::contains<double>(plant.corners, d)) return {d, plant.period, true, 1};
  const Point u = polygon::nearest<double>(plant.corners, d);
  const Index samples = lasting(plant.corners, d, u, most);
  return {u, plant.period * samples, false, samples};
}

// The law `samples` samples later.
inline Law later(Law law, Index samples) {
  law.samples = std::max<Index>(0, law.samples - samples);
  law.begun += law.own > 0 ? samples : 0;
  return law;
}

// Moves a state by an input that is held.
inline void move(State& state, const Point& u, double span) {
  double* x = state.x;
  x[0] += (x[2] + 0.5 * u.x * span) * span, x[1] += (x[3] + 0.5 * u.y * span) * span;
  x[2] += u.x * span, x[3] += u.y * span;
  state.since += span;
}

// Moves a state along a piece. What steers to a velocity reaches it exactly.
inline void move(State& state, const Law& law, const Piece& piece) {
  move(state, piece.u, piece.span);
  if (!piece.lands) return;
  state.x[2] = law.samples > 0 ? law.target[0] : 0.0, state.x[3] = law.samples > 0 ? law.target[1] : 0.0;
}

// Follows a manoeuvre until it is at rest, and returns whether it gets there and every piece passes
// `holds(state, u, span)`; the state is then that at rest.
template <class Holds>
bool follow(const Plant& plant, Law law, State& state, const Holds& holds) {
  for (Index n = 0; n < MOST_PIECES; ++n) {
    if (is_at_rest(law, state.x)) return true;
    const Piece piece = next(plant, law, state.x);
    if (!holds(state, piece.u, piece.span)) return false;
    move(state, law, piece);
    law = later(law, piece.samples);
  }
  return false;
}

}  // namespace hcbf::manoeuvres
