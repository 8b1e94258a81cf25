// The monitor of N plants of any model: what input and motion their steps show.
//
// The input: Δu = g⁺(x' − step(x, u, T)) / T. The motion is what no input explains: with û = u + Δu, the
// input that seems to have arrived, and Π = I − g g⁺, the part of the state that no input reaches within
// one period, s = Π (x' − step(x, û, T)) and Δ = Π (x' − x). A state that an input drives at once and
// that drives no other belongs to the motion, too. `monitor` has what is made of them.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/monitor.hpp>
#include <hcbf/pseudo_inverse.hpp>

namespace hcbf::model_monitor {

constexpr double STILL = 0.002;    // of what the largest inputs change in τ: a smaller motion is rounding
constexpr double ROUNDING = 1e-9;
constexpr double WRAPPED = 0.5;    // how near to a whole turn a jump must be to be one [rad]
constexpr double TURN = 6.283185307179586;

struct Watched {  // what a monitor never changes
  double period;                  // T [s]
  double radius;                  // the largest norm of an input
  double confidence;              // κ
  Vector<const double> largest;   // (n_u,) of each input
  Vector<const bool> steered;     // (n,) the states that Δu is read from
};

struct Sample {  // of N plants
  Matrix<const double> body;   // (N, n) their states
  Matrix<const double> model;  // (N, n) those of their reduced-order models
  Matrix<const double> f;      // (N, n) at the body's
  Cube<const double> g;        // (N, n, n_u) at the body's
  Cube<const double> g_model;  // (N, n, n_u) at the model's
};

struct Arrival {  // what seems to have become of the chosen input
  Matrix<double> chosen;  // (N, n_u) u
  Cube<double> to_input;  // (N, n_u, n) g⁺
  Matrix<double> u;       // (N, n_u) û
  Vector<bool> other;     // (N,) whether it differs from u
  Matrix<double> body;    // (N, n) where it leads
  Matrix<double> model;   // (N, n) where u leads the model
};

struct Seen {  // two samples
  Sample now, last;
  Arrival arrival;    // of the input between them
  Cube<double> sums;  // (N, 2, n) r and m', written to
};

struct Room {  // for one plant after the other
  Room(Index n, Index n_u) : numbers(n_u * (3 * n + n_u) + 4 * n), n(n), n_u(n_u) {}
  Matrix<double> steered() { return {numbers.data(), n, n_u}; }
  Matrix<double> inverse() { return {numbers.data() + n * n_u, n_u, n}; }
  Matrix<double> columns() { return {numbers.data() + 2 * n * n_u, n, n_u}; }
  Matrix<double> turns() { return {numbers.data() + 3 * n * n_u, n_u, n_u}; }
  Matrix<double> parts() { return {numbers.data() + n_u * (3 * n + n_u), 4, n}; }

  std::vector<double> numbers;
  Index n, n_u;
};

// Returns whether two samples are one period apart, and both are valid.
inline bool compares(const Watched& watched, const plants::Plant& plant, bool accepted) {
  const double period = watched.period;
  return accepted && plant.follows != 0 && period > 0.0 && plant.elapsed == period;
}

// x − expected, without the whole turn of an angle that is wrapped.
inline double missed(double x, double expected) {
  const double missed = x - expected, turned = missed - TURN * ((missed > 0.0) - (missed < 0.0));
  return std::abs(turned) < WRAPPED ? turned : missed;
}

// Writes û and g⁺, and returns whether any input seems to differ from the chosen one. `accepted` (N,):
// whether this sample is valid; `x` (N, n): states of the bodies; `g` (N, n, n_u): at the sample before;
// `arrival.body` holds where u leads.
inline bool arrivals(const Watched& watched, Records<plants::Plant> plants, Vector<const bool> accepted,
                     Matrix<const double> x, Cube<const double> g, const Arrival& arrival, Room& room) {
  const Index n = g.rows, n_u = g.columns;
  const Matrix<double> steered = room.steered();
  bool some = false;
  for (Index i = 0; i < plants.size; ++i) {
    arrival.other[i] = false;
    if (!compares(watched, plants[i], accepted[i])) continue;
    for (Index k = 0; k < n; ++k)
      for (Index j = 0; j < n_u; ++j) steered(k, j) = watched.steered[k] ? g(i, k, j) : 0.0;
    pseudo_inverse::write(steered, arrival.to_input[i], room.columns(), room.turns());
    double furthest = 0.0;
    for (Index j = 0; j < n_u; ++j) {
      double off = 0.0;
      for (Index k = 0; k < n; ++k) off += arrival.to_input(i, j, k) * missed(x(i, k), arrival.body(i, k));
      const double most = 2.0 * watched.largest[j];
      off = std::min(std::max(off / watched.period, -most), most);
      arrival.u(i, j) = arrival.chosen(i, j) + off;
      furthest = std::max(furthest, std::abs(off));
    }
    arrival.other[i] = furthest > ROUNDING * watched.radius;
    some |= arrival.other[i];
  }
  return some;
}

// tr(A P Aᵀ).
inline double trace(Matrix<const double> a, Matrix<const double> covariance) {
  double trace = 0.0;
  for (Index j = 0; j < a.rows; ++j)
    for (Index k = 0; k < a.columns; ++k)
      for (Index q = 0; q < a.columns; ++q) trace += a(j, k) * covariance(k, q) * a(j, q);
  return trace;
}

// Accounts for Δu, where the state's noise does not hide it; returns whether that alarms. `to_input`
// (n_u, n): g⁺ at the state before; `x` (n,): of the model; `expected` (n,): of it; `u` (n_u,): chosen;
// `noisy`: tr(g⁺ P g⁺ᵀ).
inline bool misses(const Watched& watched, plants::Plant& plant, Matrix<const double> to_input,
                   Vector<const double> x, Vector<const double> expected, Vector<const double> u,
                   double noisy) {
  const double period = watched.period, confidence = watched.confidence;
  double error = 0.0, chosen = 0.0;
  for (Index j = 0; j < u.size; ++j) {
    double off = 0.0;
    for (Index k = 0; k < x.size; ++k) off += to_input(j, k) * missed(x[k], expected[k]);
    off /= period;
    error += off * off;
    chosen += u[j] * u[j];
  }
  if (!std::isfinite(error)) return false;
  const double least = 2.0 * (confidence * confidence) * noisy / (period * period);
  if (monitor::SHARE * monitor::SHARE * chosen <= least && noisy > 0.0) chosen = 0.0;
  return monitor::account(plant.inputs, error, chosen, period / monitor::WINDOW, watched.radius);
}

// Takes Π v in the place of v (n,); g counts in the steered states alone. `scratch` (n,) is written to.
inline void unreached(Matrix<const double> g, Vector<const bool> steered, Matrix<const double> to_input,
                      Vector<double> v, Vector<double> scratch) {
  std::copy_n(v.data, v.size, scratch.data);
  for (Index j = 0; j < g.columns; ++j) {
    double along = 0.0;
    for (Index k = 0; k < v.size; ++k) along += to_input(j, k) * scratch[k];
    for (Index k = 0; k < v.size; ++k)
      if (steered[k]) v[k] -= g(k, j) * along;
  }
}

// tr(Π P Π); Π is symmetric, so that it is tr(Π P). `column` and `scratch` (n,) are written to.
inline double unreached_trace(Matrix<const double> g, Vector<const bool> steered,
                              Matrix<const double> to_input, Matrix<const double> covariance,
                              Vector<double> column, Vector<double> scratch) {
  double trace = 0.0;
  for (Index k = 0; k < covariance.rows; ++k) {
    if (covariance(k, k) == 0.0) continue;
    for (Index q = 0; q < covariance.rows; ++q) column[q] = covariance(q, k);
    unreached(g, steered, to_input, column, scratch);
    trace += column[k];
  }
  return std::max(0.0, trace);
}

// Accounts for what no input explains of plant i, and returns whether that alarms.
inline bool moves_off(const Watched& watched, plants::Plant& plant, Index i, const Seen& seen,
                      Matrix<const double> covariance, Matrix<double> parts) {
  const Sample &now = seen.now, &last = seen.last;
  const Matrix<double> sums = seen.sums[i];
  const Arrival& arrival = seen.arrival;
  const Vector<const double> x = now.body[i], before = last.body[i];
  const Matrix<const double> g = last.g[i], to_input = arrival.to_input[i];
  double size = 0.0, driven = 0.0;
  for (Index k = 0; k < x.size; ++k) {
    parts(0, k) = missed(x[k], arrival.body(i, k));
    parts(1, k) = arrival.body(i, k) - before[k];
    parts(2, k) = now.f(i, k) - last.f(i, k);
    size = std::max(size, std::abs(x[k]));
    for (Index j = 0; j < g.columns; ++j) {
      parts(2, k) += (now.g(i, k, j) - g(k, j)) * arrival.u(i, j);
      const double most = g(k, j) * watched.largest[j];
      driven += most * most;
    }
  }
  for (Index part = 0; part < 3; ++part) unreached(g, watched.steered, to_input, parts[part], parts[3]);
  double change = 0.0, total = 0.0;
  for (Index k = 0; k < x.size; ++k) {
    change += parts(2, k) * parts(2, k);
    total += parts(0, k) + parts(1, k) + parts(2, k);
  }
  if (!std::isfinite(total + change)) return false;
  const double rest = STILL * monitor::WINDOW * std::sqrt(driven) + ROUNDING * size;
  const double unknown = unreached_trace(g, watched.steered, to_input, covariance, parts[2], parts[3]);
  const double spread = watched.confidence * std::sqrt(unknown);
  return monitor::strays(plant.motion, &sums(0, 0), &sums(1, 0),
                         {parts[0], parts[1], std::sqrt(change), rest, spread, watched.period});
}

// Accounts for a sample of N plants, and raises their alarms. `covariance` (N, n, n): of x, 0 where that
// is the truth; `accepted` (N,): whether this sample is valid.
inline void observe(const Watched& watched, Records<plants::Plant> plants, Vector<const bool> accepted,
                    Cube<const double> covariance, const Seen& seen, Room& room) {
  const Matrix<double> inverse = room.inverse();
  for (Index i = 0; i < plants.size; ++i) {
    plants::Plant& plant = plants[i];
    if (!accepted[i]) continue;
    if (plant.fault >= reason::FIRST_ALARM) monitor::latch(plant, plant.fault);
    if (compares(watched, plant, true)) {
      pseudo_inverse::write(seen.last.g_model[i], inverse, room.columns(), room.turns());
      const double noisy = plant.has_model ? 0.0 : trace(inverse, covariance[i]);
      const Arrival& arrival = seen.arrival;
      if (misses(watched, plant, inverse, seen.now.model[i], arrival.model[i], arrival.chosen[i], noisy))
        monitor::latch(plant, reason::INPUT);
      if (moves_off(watched, plant, i, seen, covariance[i], room.parts()))
        monitor::latch(plant, reason::MOTION);
    }
    plant.follows = 1;
  }
}

}  // namespace hcbf::model_monitor
