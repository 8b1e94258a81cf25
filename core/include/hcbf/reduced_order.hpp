// Point masses: p' = v, v' = u − c v, and the integrator whose speed is capped.
#pragma once
#include <array>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::reduced_order {

// f(x) = (v, −c v) at x = (p, v).
inline void damped_drift(Vector<const double> x, double drag, Vector<double> f) {
  const Index k = x.size / 2;
  for (Index i = 0; i < k; ++i) f[i] = x[k + i], f[k + i] = -drag * x[k + i];
}

// x after dt under a constant u (k,): one Runge–Kutta step of 4th order.
inline void damped_step(Vector<const double> x, Vector<const double> u, double dt, double drag,
                        Vector<double> after) {
  const Index k = u.size;
  for (Index i = 0; i < k; ++i) {
    const double v = x[k + i], a1 = u[i] - drag * v;
    const double v2 = v + 0.5 * dt * a1, a2 = u[i] - drag * v2;
    const double v3 = v + 0.5 * dt * a2, a3 = u[i] - drag * v3;
    const double v4 = v + dt * a3, a4 = u[i] - drag * v4;
    after[i] = x[i] + dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
    after[k + i] = v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
  }
}

// The double integrator after dt, exactly, its speed capped at v_max:
// v' = v + u dt (scaled back where it exceeds v_max), p' = p + (v + v') dt / 2.
inline std::array<double, 4> double_integrator_step(Vector<const double> x, Vector<const double> u, double dt,
                                                    double v_max) {
  double vx = x[2] + u[0] * dt, vy = x[3] + u[1] * dt;
  const double speed = std::sqrt(vx * vx + vy * vy);
  if (speed > v_max) {
    const double scale = v_max * (1.0 - 1e-12) / speed;  // below the limit whichever way it is rounded
    vx = scale * vx, vy = scale * vy;
  }
  return {x[0] + 0.5 * (x[2] + vx) * dt, x[1] + 0.5 * (x[3] + vy) * dt, vx, vy};
}

}  // namespace hcbf::reduced_order
