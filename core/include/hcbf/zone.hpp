// Speed limits by place: the robot brakes before it enters a zone. With d⁺ the distance to the nearest
// cell of the zone, 0 inside, L the limit there and β a deceleration that every robot here can do,
//
//     h = (L² + 2 β d⁺ − ‖v‖²) / (2 L),
//
// in m/s as a speed limit's. Its zero is the speed from which braking by β reaches L at the edge.
// docs/rows.md derives the row of an input that is held.
#pragma once
#include <algorithm>

#include <hcbf/class_k.hpp>

// A cap on the speed, h = (v_max² − ‖v‖²) / (2 v_max); its gradient is −v/v_max, its Hessian −1/v_max.
namespace hcbf::speed_limit {

template <class Number>
Number value(const Number& v_max, const Number& vx, const Number& vy) {
  return (v_max * v_max - vx * vx - vy * vy) / (2.0 * v_max);
}

}  // namespace hcbf::speed_limit

namespace hcbf::zone {

template <class Number>
struct RowOf {
  Number b;
  Number alpha2_psi;  // α₂(ψ)
  Number psi;         // ψ
};

constexpr double BRAKING = 1.0;  // β, with which a robot slows down before a zone [m/s²]

// h at the distance d⁺ = `away` [m] and the velocity (vx, vy).
template <class Number>
Number value(const Number& limit, const Number& away, const Number& vx, const Number& vy) {
  return (limit * limit + 2.0 * BRAKING * away - vx * vx - vy * vy) / (2.0 * limit);
}

// The row of a zone, whose gradient is −v/L. `kept` is h − m [m/s], `margin_rate` ṁ [m/s²], `closing`
// d/dt of d⁺, not positive while the robot comes nearer [m/s], `limit` L [m/s]. u_max changes the
// speed; `hardest` is the greatest acceleration of the position [m/s²], more than u_max where the
// velocity turns by itself.
template <class Number>
RowOf<Number> row(const Number& kept, const Number& margin_rate, const Number& closing, const Number& vx,
                  const Number& vy, const Number& limit, const RowSettings& s, double hardest) {
  using namespace functions;
  const Number alpha2_psi = class_k::value(s.alpha_speed, kept), drift = BRAKING * closing / limit;
  Number b = -alpha2_psi;
  if (s.held == 0.0) return {b - drift + margin_rate, alpha2_psi, kept};
  const double strays = BRAKING * (hardest - s.u_max);
  const Number cost = ((s.u_max + BRAKING) * s.u_max + strays) * s.period / (2.0 * limit);
  b = kept >= 0.0 ? max(b, cost - kept / s.period) : b + cost;
  const Number stop = (vx * vx + vy * vy) / (limit * s.period);  // a full stop gives no more
  return {min(b - drift, stop) + margin_rate, alpha2_psi, kept};
}

// The distance from which a robot has to brake for a zone [m]: `limit` L, `margin` m, and `fastest`, its
// greatest speed meanwhile [m/s].
inline double reach(double limit, double margin, double fastest) {
  return std::max(0.0, fastest * fastest - limit * (limit - 2.0 * margin)) / (2.0 * BRAKING);
}

}  // namespace hcbf::zone
