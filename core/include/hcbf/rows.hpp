// Rows of the double integrator: the usual ones, and those for an input that is held.
//
// docs/rows.md derives them. A held row keeps h ≥ 0 between two samples, too: with T the period, r the
// velocity in the barrier's frame, m the margin and ṁ its rate, and H convex with ‖∇H‖ ≤ 1,
//
//     h(τ) − m(τ) ≥ (h − m) + (ḣ − ṁ) τ + ½ a·u τ²,     ḣ(T) ≥ ḣ + a·u T − ν,
//
// and the row requests ψ(T) ≥ ψ − T α₂(ψ) in terms of these bounds. It is linear in u because a chord
// bounds α₁ from below.
#pragma once
#include <algorithm>
#include <limits>

#include <hcbf/class_k.hpp>
#include <hcbf/shapes.hpp>
#include <hcbf/zone.hpp>

namespace hcbf::rows {

using zone::RowOf;
using namespace functions;

// Of the first axis of what `rows` writes.
constexpr int B = 0, H = 1, ALPHA2_PSI = 2, PSI = 3;

template <class Number>
struct Reserved {  // what a row reserves between h and zero
  Number margin;      // m
  Number rate;        // ṁ
  Number quickening;  // m̈
};

template <class Number>
struct PlacedRow {  // of a barrier on the position
  Number b, alpha2_psi, psi;
  Number lost;  // by how much less h − m gains with every input than a·u [m/s²]
};

// ½ ū T², the most that a held input moves h by [m].
inline double half_step(const RowSettings& s) { return 0.5 * s.u_max * s.period * s.period; }

// ℓ, how far the barrier's frame sees the robot get in one period [m].
template <class Number>
Number reach_of(const Number& speed, const RowSettings& s) { return speed * s.period + half_step(s); }

// What h keeps so that no held input reaches the core of a region, which reaches `radius` beyond it [m].
template <class Number>
Number beside_core(const Number& radius, const RowSettings& s) {
  return max(0.0, half_step(s) - radius);
}

// The most that an input of U gives of a·u; −∞ where U is not known. U counts as the intersection of
// its limits and its radius.
template <class Number>
inline Number support(const RowSettings& s, const Number& ax, const Number& ay) {
  if (s.u_max == 0.0) return -INF;
  const Number along_x = max(ax * s.low[0], ax * s.high[0]);
  const Number along_y = max(ay * s.low[1], ay * s.high[1]);
  return min(along_x + along_y, s.u_max * sqrt(ax * ax + ay * ay));
}

// ν, by how much ḣ(T) may fall short of ḣ + a·u T as the gradient turns [m/s].
template <class Number>
inline Number turning(const Number& speed, const Number& sideways, const Number& distance, const RowSettings& s) {
  if (distance == INF) return 0.0;
  const double period = s.period, u_max = s.u_max;
  const Number reach = reach_of(speed, s);
  const Number mean = max(Number(0.5 * u_max * period * period),
                          0.5 * (distance + max(distance - reach, 0.0)));
  const Number loss = u_max * u_max * (period * (period * period)) / (16.0 * mean);
  const Number across = max(0.0, sideways - 0.5 * u_max * period), farthest = distance + reach;
  const Number gain = distance * across * sqrt(period / (farthest * (farthest * farthest)));
  const Number more = max(0.0, gain - sqrt(loss));
  return loss - more * more;
}

// The row of a barrier on the position at this instant alone.
template <class Number>
inline PlacedRow<Number> usual_row(const Number& kept, const Number& rate, const Number& quickening,
                                   const Number& sideways, const Number& distance,
                                   const class_k::ClassK& alpha1, const class_k::ClassK& alpha2) {
  const Number psi = rate + class_k::value(alpha1, kept), alpha2_psi = class_k::value(alpha2, psi);
  const Number lost = quickening - sideways * sideways / distance;  // what turns, turns h away by itself
  return {lost - alpha2_psi - class_k::slope(alpha1, kept) * rate, alpha2_psi, psi, lost};
}

// The row of a barrier on the position while u is held for T: `kept` is h − m, less what `beside_core`
// reserves [m], `rate` ḣ − ṁ [m/s], `quickening` m̈ [m/s²], `speed` ‖r‖ in the barrier's frame,
// `sideways` the speed across the direction from the core, 0 if that is no point [m/s], and `distance`
// that from the core, infinite where the gradient does not turn [m].
template <class Number>
inline PlacedRow<Number> held_row(const Number& kept, const Number& rate, const Number& quickening,
                                  const Number& speed, const Number& sideways, const Number& distance,
                                  const RowSettings& s) {
  const double period = s.period, half = half_step(s);
  const Number psi = rate + class_k::value(s.alpha1, kept), alpha2_psi = class_k::value(s.alpha2, psi);

  const Number end = kept + rate * period, lowest = end - half, highest = end + half;
  const Number chord = class_k::slope(s.alpha1, max(abs(lowest), abs(highest)));
  const Number promised = class_k::value(s.alpha1, lowest) + chord * half;
  const Number nu = turning(speed, sideways, distance, s) + quickening * period;
  const Number least = psi - period * alpha2_psi - rate + nu;
  Number b = (least - promised) / (period + 0.5 * chord * period * period);
  // h ≥ 0 meanwhile, whatever α₁
  if (kept >= 0.0 && end >= 0.0) b = max(b, -2.0 * end / (period * period));
  return {b, alpha2_psi, psi, nu / period};
}

// What a row requests where ψ < 0: to stop at h = m at a constant rate, if U can. `most` is a·u of the
// input of U that gives most of it, and `lost` how much less h − m gains with every input [m/s²].
template <class Number>
inline Number late(const Number& kept, const Number& rate, const Number& lost, const Number& most) {
  if (rate >= 0.0 || kept <= 0.0) return -INF;
  return min(rate * rate / (2.0 * kept) + lost, most);
}

// The row of a speed limit, with ψ = h; h is concave in v, so that u costs ‖u‖².
template <class Number>
inline RowOf<Number> speed_row(const Number& kept, const Number& margin_rate, const Number& vx, const Number& vy,
                        const Number& v_max, const RowSettings& s) {
  const Number alpha2_psi = class_k::value(s.alpha_speed, kept);
  Number b = -alpha2_psi;
  if (s.held != 0.0) {
    const Number cost = s.u_max * s.u_max * s.period / (2.0 * v_max);
    b = kept >= 0.0 ? max(b, cost - kept / s.period) : b + cost;
    b = min(b, (vx * vx + vy * vy) / (v_max * s.period));  // a full stop gives no more
  }
  return {b + margin_rate, alpha2_psi, kept};
}

template <class Number>
struct Bound {
  Number b, h, alpha2_psi, psi;
};
constexpr Bound<double> NO_ROW{-1.0, 1.0, 1.0, 1.0};  // every input meets it

// Writes a (2,) of one barrier at a state x (4,) and time t, and returns the rest of its row. A user's
// own barrier is not for this function. A class of a map has NaN: only its nearby pieces have rows.
template <class Number>
inline Bound<Number> row(Index kind, const Number* c, const Reserved<Number>& reserved, const Number* x, double t,
                  const RowSettings& s, Number* a) {
  if (kind == layout::NONE) {
    a[0] = a[1] = 0.0;
    return {NO_ROW.b, NO_ROW.h, NO_ROW.alpha2_psi, NO_ROW.psi};
  }
  if (kind == layout::MAPPED || kind == layout::ZONES) {
    constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
    a[0] = a[1] = NaN;
    return {NaN, NaN, NaN, NaN};
  }
  const Number vx = x[2], vy = x[3];
  if (kind == layout::ZONE) {
    const Number limit = c[layout::V_MAX];
    a[0] = -vx / limit, a[1] = -vy / limit;
    const Number h = zone::value(limit, c[layout::AWAY], vx, vy);
    const Number closing = c[layout::AWAY_X] * vx + c[layout::AWAY_Y] * vy;
    const RowOf<Number> r = zone::row<Number>(h - reserved.margin, reserved.rate, closing, vx, vy, limit, s, s.u_max);
    return {r.b, h, r.alpha2_psi, r.psi};
  }
  if (kind == layout::SPEED_LIMIT) {
    const Number v_max = c[layout::V_MAX];
    a[0] = -vx / v_max, a[1] = -vy / v_max;
    const Number h = speed_limit::value(v_max, vx, vy);
    const RowOf<Number> r = speed_row<Number>(h - reserved.margin, reserved.rate, vx, vy, v_max, s);
    return {r.b, h, r.alpha2_psi, r.psi};
  }
  const auto [qx, qy] = shapes::in_frame(c, x[0], x[1], t);
  const Number rx = vx - c[layout::VELOCITY_X], ry = vy - c[layout::VELOCITY_Y];
  const PlanarJetOf<Number> at = shapes::jet(kind, c, qx, qy);
  a[0] = at.gx, a[1] = at.gy;
  Number kept = at.h - reserved.margin;
  const Number rate = at.gx * rx + at.gy * ry - reserved.rate, sideways = abs(at.tx * rx + at.ty * ry);
  PlacedRow<Number> r;
  if (s.held == 0.0) {
    r = usual_row(kept, rate, reserved.quickening, sideways, at.distance, s.alpha1, s.alpha2);
  } else {
    const Number speed = sqrt(rx * rx + ry * ry);
    const CoreOf<Number> core = shapes::core(kind, c, qx, qy, at, reach_of(speed, s));
    kept -= beside_core(core.radius, s);
    r = held_row(kept, rate, reserved.quickening, speed, core.is_point ? sideways : 0.0, core.distance, s);
  }
  if (r.psi < 0.0) r.b = max(r.b, late(kept, rate, r.lost, support(s, at.gx, at.gy)));
  return {r.b, at.h, r.alpha2_psi, r.psi};
}

// Writes that a state has no row in place k: a (M, n_u), and rows (4, M) b, h, α₂(ψ) and ψ.
inline void leave_out(Index k, Matrix<double> a, Matrix<double> rows) {
  for (double& entry : a[k]) entry = 0.0;
  rows(B, k) = NO_ROW.b, rows(H, k) = NO_ROW.h, rows(ALPHA2_PSI, k) = NO_ROW.alpha2_psi, rows(PSI, k) = NO_ROW.psi;
}

// Writes the rows of a state x (4,) at a time t; those of users' own barriers are passed over.
//
// kind (m,) and parameters (m, WIDTH) as `BarrierSet` in Python holds them; margin (3 or more, m) what each
// row reserves between h and zero, the rate of that, and the rate of that again; a (m, 2) and out (4, m) b,
// h, α₂(ψ) and ψ are written.
inline void of_state(Vector<const Index> kind, Matrix<const double> parameters, Matrix<const double> margin,
                     const double* x, double t, const RowSettings& settings, Matrix<double> a,
                     Matrix<double> out) {
  for (Index k = 0; k < kind.size; ++k) {
    if (kind[k] == layout::CUSTOM) continue;
    const Reserved<double> reserved{margin(0, k), margin(1, k), margin(2, k)};
    const Bound<double> r = row(kind[k], parameters[k].data, reserved, x, t, settings, a[k].data);
    out(B, k) = r.b, out(H, k) = r.h, out(ALPHA2_PSI, k) = r.alpha2_psi, out(PSI, k) = r.psi;
  }
}

// Writes the rows of N states x (N, 4) at times t (N,), with a leading N in what `of_state` takes and margin
// (3 or more, N, m) and out (4, N, m).
inline void rows(Matrix<const Index> kind, Cube<const double> parameters, Cube<const double> margin,
                 Matrix<const double> x, Vector<const double> t, const RowSettings& settings, Cube<double> a,
                 Cube<double> out) {
  const Index m = kind.columns, all = x.rows * m;
  for (Index i = 0; i < x.rows; ++i)
    of_state(kind[i], parameters[i], {margin.data + i * m, 3, all}, x[i].data, t[i], settings, a[i],
             {out.data + i * m, 4, all});
}

// Whether a condition is on the speed, not on the place.
inline bool is_on_speed(Index kind) { return kind == layout::SPEED_LIMIT || kind == layout::ZONE; }

}  // namespace hcbf::rows
