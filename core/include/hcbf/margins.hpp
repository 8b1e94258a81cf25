// Margins: how much each row reserves between h and zero, for the uncertainty of this sample.
//
// For a barrier on the position with the unit normal n = ∇h/‖∇h‖,
//   m = d + min(cap, k_v max(0, −n·e_v) + k_p max(0, n·e_p)) + max(0, n·(p − b)) + κσ + ρ,
// where e = (e_p, e_v) is the tracking error, the body's state minus the reduced-order model's; p the
// position that the row reads, b the body's; σ the standard deviation of the estimated position; and ρ
// how far the body reaches. A speed limit reserves d_s + k_s ‖e_v‖ + κ √λ(P_vv) [m/s], λ the largest
// eigenvalue. Beside a wall σ = √(nᵀ P_pp n); where n turns as the robot moves, it is that of the worst
// direction, √λ(P_pp). Over a hold T it grows at most at ṁ = κ √(nᵀ P_vv(T) n) or κ √λ(P_vv(T)), with
// P_vv(T) ≤ P_vv + g, g what it grew by since the last sample; m̈ is how fast ṁ grows.
//
// Any model ẋ = f(x) + g(x)u and any h(x) reserve the same: with p in x, a = ∇h, e_v the difference of ṗ
// between body and model under one input, and V = (∂f/∂x) P (∂f/∂x)ᵀ,
//   m = ‖a_p‖ (d + ρ) + min(‖a_p‖ cap, …) + max(0, a·(x − x_b)) + κ σ(a, P),   ṁ = κ σ(a, V),
// with σ(a, C) = √(aᵀ C a) beside a wall, and ‖a_p‖ √λ(C_pp) + √(a_rᵀ C_rr a_r) elsewhere, r the rest of
// x. Where g is not the same everywhere, a hold adds T κ Σ σ(a, W_j) to m, W_j the covariance of
// g_j(x) u_j for the largest u_j. An h that is not convex adds what it may lose in second order.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>
#include <hcbf/shapes.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/zone.hpp>

namespace hcbf::margins {

constexpr double UNIT = 1.0 + 1e-9;  // a smaller slope counts as 1: a distance has it, but for rounding
constexpr double SHORT = 1e-4;       // by how much h − m [m], ψ [m/s] and a speed limit may be missed

// The margins of a row in their order; of planar double integrators the first four.
enum { MARGIN, RATE, QUICKENING, USABLE, REACH, FAST };

// One sample of a planar double integrator.
struct Known {
  const double* x;                  // (4,) position [m] and velocity [m/s], as the rows read them
  double time;                      // [s]
  const double* model;              // (4,) the reduced-order model's own state
  const double* lag;                // (4,) the body's state minus the reduced-order model's
  Matrix<const double> covariance;  // (4, 4) of x
  double growth;                    // g, by how much that of the velocity grows until the next sample [m²/s²]
};

// The uncertainty of one state, as the row of any h reads it.
struct Unknown {
  Vector<const double> off;    // (n,) x − x_b, the state that the rows read less the body's
  Vector<const double> lead;   // (n_p,) the body's position minus the model's
  Matrix<const double> slip;   // (1 + S, ≥ n_p) the body's ṗ minus the model's: of the drift, then of each
                               // input at its largest
  Matrix<const double> state;  // (n, n) P
  Matrix<const double> drift;  // (k, k) V of the position, k = n_p, or of all of x, k = n
  double growth;               // g, by how much V of the position grows until the next sample
  Cube<const double> turns;    // (S, n, n) the covariance of g(x)u, of each input at its largest; S = 0 where
                               // g is the same everywhere
};

// What is reserved for a standard deviation, of every row and model; linear in it.
inline double reserved(const Uncertainty& settings, double deviation) { return settings.confidence * deviation; }

// The larger eigenvalue of a symmetric matrix (2, 2), 0 where it is negative.
inline double greater(double xx, double xy, double yy) {
  const double half = 0.5 * (xx - yy);
  return std::max(0.0, 0.5 * (xx + yy) + std::sqrt(half * half + xy * xy));
}

// The largest eigenvalue of the block (2, 2) of the covariance that starts at (i, i).
inline double largest(Matrix<const double> covariance, Index i) {
  return greater(covariance(i, i), covariance(i, i + 1), covariance(i + 1, i + 1));
}

// The variance of the worst direction of the first `size` states; beyond two a bound of it.
inline double worst(Matrix<const double> covariance, Index size) {
  if (size == 2) return largest(covariance, 0);
  double most = 0.0;
  for (Index j = 0; j < size; ++j) {
    double row = 0.0;
    for (Index q = 0; q < size; ++q) row += std::abs(covariance(j, q));
    most = std::max(most, row);
  }
  return most;
}

// Whether a covariance is zero: where no variance is, nothing is correlated.
inline bool is_exact(Matrix<const double> covariance) {
  double deviates = 0.0;
  for (Index j = 0; j < covariance.rows; ++j) deviates += covariance(j, j);
  return deviates == 0.0;
}

// g, by how much the velocity's variance grew in its worst direction [m²/s²]. `before`: (3,) xx, xy and
// yy of the velocity's at the last sample.
inline double growth_of(Matrix<const double> covariance, Vector<const double> before) {
  const double xx = covariance(2, 2), xy = covariance(2, 3), yy = covariance(3, 3);
  return greater(xx - before[0], xy - before[1], yy - before[2]);
}

// Whether a body is faster than a limit [m/s], by more than rounding. `x`: of the model, with the
// velocity in x[2] and x[3]; `lag`: the body's state minus the model's.
inline bool is_fast(double limit, const double* x, const double* lag) {
  const double vx = x[2] + lag[2], vy = x[3] + lag[3];
  return vx * vx + vy * vy > (limit + SHORT) * (limit + SHORT);
}

// The most that a row on the position with ‖∇h‖ ≤ 1 reserves [m]; see `derive`.
inline double most(const Uncertainty& settings, const Known& known) {
  const double ahead_x = known.x[0] - known.model[0] - known.lag[0];
  const double ahead_y = known.x[1] - known.model[1] - known.lag[1];
  const double ahead = std::sqrt(ahead_x * ahead_x + ahead_y * ahead_y);
  const double spread = reserved(settings, std::sqrt(largest(known.covariance, 0)));
  return settings.distance + settings.cap + ahead + spread + settings.body;
}

// The margin of a speed limit's row [m/s].
inline double of_speed(const Uncertainty& settings, const double* lag, Matrix<const double> covariance) {
  const double slip = std::sqrt(lag[2] * lag[2] + lag[3] * lag[3]);
  const double sure = settings.speed + settings.speed_per_velocity * slip;
  return sure + reserved(settings, std::sqrt(largest(covariance, 2)));
}

// The greatest ṁ of any row on the position, now and at the next sample [m/s].
inline double fastest_drift(const Uncertainty& settings, Matrix<const double> covariance, double growth) {
  if (covariance(2, 2) == 0.0 && covariance(3, 3) == 0.0) return 0.0;
  return reserved(settings, std::sqrt(largest(covariance, 2) + 2.0 * growth));
}

// How fast the margin of a speed limit grows at most [m/s²].
inline double speed_growth(const Uncertainty& settings, Matrix<const double> covariance, double growth,
                           double period) {
  if (period == 0.0 || is_exact(covariance)) return 0.0;
  const double variance = largest(covariance, 2);
  const double later = std::sqrt(variance + growth), now = std::sqrt(variance);
  return reserved(settings, later - now) / period;
}

// σ(a, C), with C_pp greater by `growth` in every direction. `c`: (k, k) C, of the first k states;
// `placed`: n_p; `steep`: ‖a_p‖; `straight`: whether a is the same everywhere.
inline double deviation(Matrix<const double> c, double growth, Vector<const double> gradient, Index placed,
                        double steep, bool straight) {
  const Index first = straight ? 0 : placed;
  double variance = straight ? steep * steep * growth : 0.0;
  for (Index j = first; j < c.rows; ++j)
    for (Index q = first; q < c.rows; ++q) variance += gradient[j] * c(j, q) * gradient[q];
  const double root = std::sqrt(std::max(0.0, variance));
  return straight ? root : root + steep * std::sqrt(worst(c, placed) + growth);
}

struct Growing {
  double rate;        // ṁ = κ σ(a, V + g)
  double quickening;  // m̈, by how much more it is at the next sample, over T
};

inline Growing growing(const Uncertainty& settings, const Unknown& unknown, Vector<const double> gradient,
                       double steep, bool straight, double period) {
  if (is_exact(unknown.state)) return {0.0, 0.0};
  const double growth = unknown.growth;
  const auto grown = [&](double by) {
    return reserved(settings, deviation(unknown.drift, by, gradient, unknown.lead.size, steep, straight));
  };
  const double rate = grown(growth);
  if (growth == 0.0 || period == 0.0) return {rate, 0.0};
  return {rate, (grown(2.0 * growth) - rate) / period};
}

struct Row {
  double margin;      // m [m], of speed limits [m/s]
  double rate;        // ṁ [m/s]
  double quickening;  // m̈ [m/s²]
  double usable;      // what of m errors may use up: the tracking error's part, less what `cap` cuts off of
                      // it, and the errors of a measured region [m]
  double steep;       // ‖a_p‖
};

// The margins of the row of a condition. `gradient`: (n,) ∇h; a is written to it. `period`: T [s], 0 where it is
// unknown.
inline Row of_row(const Uncertainty& settings, const Unknown& unknown, Vector<double> gradient, Index kind,
                  double period) {
  const bool straight = kind == HalfPlane::CODE;  // ∇h is the same everywhere
  const Index placed = unknown.lead.size;
  double steep2 = 0.0, ahead = 0.0, lead = 0.0, faster = 0.0, turned = 0.0;
  for (Index j = 0; j < placed; ++j) steep2 += gradient[j] * gradient[j];
  double steep = std::sqrt(steep2);
  if (0.0 < steep && steep < UNIT) {
    for (Index j = 0; j < placed; ++j) gradient[j] /= steep;
    steep = 1.0;
  }
  for (Index j = 0; j < gradient.size; ++j) ahead += gradient[j] * unknown.off[j];
  for (Index j = 0; j < placed; ++j) lead += gradient[j] * unknown.lead[j];
  for (Index s = 0; s < unknown.slip.rows; ++s) {
    double away = 0.0;
    for (Index j = 0; j < placed; ++j) away += gradient[j] * unknown.slip(s, j);
    faster += s > 0 ? std::abs(away) : -away;
  }
  const double tracking =
      settings.per_velocity * std::max(0.0, faster) + settings.per_lead * std::max(0.0, lead);
  const double cap = steep * settings.cap;
  const double spread = deviation(unknown.state, 0.0, gradient, placed, steep, straight);
  for (Index s = 0; s < unknown.turns.layers; ++s)
    turned += deviation(unknown.turns[s], 0.0, gradient, placed, steep, straight);
  double margin = steep * (settings.distance + settings.body);
  margin += std::min(tracking, cap) + std::max(0.0, ahead);
  margin += reserved(settings, spread + period * turned);
  const Growing grown = growing(settings, unknown, gradient, steep, straight, period);
  return {margin, grown.rate, grown.quickening, cap - std::abs(cap - tracking), steep};
}

// Writes the margins of one state's rows into out (4, m). `kind` (m,) and `parameters` (m, WIDTH) as `layout`
// has them; `period`: T [s], 0 where it is unknown.
inline void derive(const Uncertainty& settings, Vector<const Index> kind, Matrix<const double> parameters,
                   const Known& known, double period, Matrix<double> out) {
  const double *x = known.x, *lag = known.lag;
  const Matrix<const double> covariance = known.covariance;
  double off[4], slope[4] = {0.0, 0.0, 0.0, 0.0};
  bool certain = is_exact(covariance);
  for (Index j = 0; j < 4; ++j) {
    off[j] = x[j] - known.model[j] - lag[j];
    certain = certain && lag[j] == 0.0 && (j > 1 || off[j] == 0.0);
  }
  const double drifting[4] = {covariance(2, 2), covariance(2, 3), covariance(3, 2), covariance(3, 3)};
  const Unknown unknown{{off, 4},         {lag, 2},     {lag + 2, 1, 2},   covariance,
                        {drifting, 2, 2}, known.growth, {nullptr, 0, 4, 4}};
  const Vector<double> gradient{slope, 4};
  Growing drift{0.0, 0.0};
  if (!certain) drift = growing(settings, unknown, gradient, 1.0, false, period);
  const double speeding = speed_growth(settings, covariance, known.growth, period);
  for (Index k = 0; k < kind.size; ++k) {
    const Index which = kind[k];
    Row row{0.0, 0.0, 0.0, 0.0, 0.0};
    if (which == layout::SPEED_LIMIT || which == layout::ZONES || which == layout::ZONE) {
      row.margin = of_speed(settings, lag, covariance), row.rate = speeding;
      if (which == layout::ZONE && parameters(k, layout::AWAY) > 0.0)
        row.rate += zone::BRAKING * drift.rate / parameters(k, layout::V_MAX);
    } else if (which == layout::CUSTOM || which == layout::MAPPED) {  // the gradient is unknown here
      row = {most(settings, known), drift.rate, drift.quickening, settings.cap, 0.0};
    } else if (which != layout::NONE) {
      if (certain) {
        row.margin = settings.distance + settings.body;
      } else {
        const auto [qx, qy] = shapes::in_frame(parameters[k].data, x[0], x[1], known.time);
        const auto jet = shapes::jet(which, parameters[k].data, qx, qy);
        slope[0] = jet.gx, slope[1] = jet.gy;
        row = of_row(settings, unknown, gradient, which, period);
      }
      if (which == ConvexPolygon::CODE) row.usable += ConvexPolygon::used(parameters[k].data);
    }
    out(MARGIN, k) = row.margin, out(RATE, k) = row.rate;
    out(QUICKENING, k) = row.quickening, out(USABLE, k) = row.usable;
  }
}

}  // namespace hcbf::margins
