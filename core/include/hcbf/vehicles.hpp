// Wheeled robots: the unicycle, x = (p, θ), and the kinematic bicycle of a small slip angle, x = (p, θ, v).
// Source: Kong et al., "Kinematic and dynamic vehicle models for autonomous driving control design", IV 2015.
#pragma once
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::vehicles {

// g (3, 2): p' = u₁ (cos θ, sin θ), θ' = u₂.
inline void unicycle_inputs(const double* x, double* g) {
  g[0] = std::cos(x[2]), g[1] = 0.0;
  g[2] = std::sin(x[2]), g[3] = 0.0;
  g[4] = 0.0, g[5] = 1.0;
}

// x after dt; where θ' is constant, the four rates of Runge and Kutta are those of Simpson's rule.
inline void unicycle_step(const double* x, const double* u, double dt, double* after) {
  const double half = x[2] + 0.5 * dt * u[1], end = x[2] + dt * u[1], forward = dt / 6.0 * u[0];
  const double px = x[0] + forward * (std::cos(x[2]) + 4.0 * std::cos(half) + std::cos(end));
  const double py = x[1] + forward * (std::sin(x[2]) + 4.0 * std::sin(half) + std::sin(end));
  after[0] = px, after[1] = py, after[2] = end;
}

// g (4, 2) of u = (a, β).
inline void bicycle_inputs(const double* x, double rear, double* g) {
  g[0] = 0.0, g[1] = -x[3] * std::sin(x[2]);
  g[2] = 0.0, g[3] = x[3] * std::cos(x[2]);
  g[4] = 0.0, g[5] = x[3] / rear;
  g[6] = 1.0, g[7] = 0.0;
}

// x' = (v (cos θ − β sin θ), v (sin θ + β cos θ), v β / ℓ_r, a).
inline void bicycle_rate(const double* x, double a, double slip, double rear, double* rate) {
  const double cos = std::cos(x[2]), sin = std::sin(x[2]);
  rate[0] = x[3] * (cos - slip * sin), rate[1] = x[3] * (sin + slip * cos);
  rate[2] = x[3] * slip / rear, rate[3] = a;
}

// x after dt: one Runge–Kutta step of 4th order.
inline void bicycle_step(const double* x, const double* u, double dt, double rear, double* after) {
  double k1[4], k2[4], k3[4], k4[4], at[4];
  bicycle_rate(x, u[0], u[1], rear, k1);
  for (int i = 0; i < 4; ++i) at[i] = x[i] + 0.5 * dt * k1[i];
  bicycle_rate(at, u[0], u[1], rear, k2);
  for (int i = 0; i < 4; ++i) at[i] = x[i] + 0.5 * dt * k2[i];
  bicycle_rate(at, u[0], u[1], rear, k3);
  for (int i = 0; i < 4; ++i) at[i] = x[i] + dt * k3[i];
  bicycle_rate(at, u[0], u[1], rear, k4);
  for (int i = 0; i < 4; ++i) after[i] = x[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
}

}  // namespace hcbf::vehicles
