// Models ẋ = f(x) + g(x)u, each asked about N states at once; where one has no answer, it gives NaN.
#pragma once
#include <algorithm>

#include <hcbf/reduced_order.hpp>
#include <hcbf/vehicles.hpp>

namespace hcbf::model {

using States = Matrix<const double>;  // (N, n)

struct Model {
  Index n, n_u;
  Index n_p;  // how many states, from the first on, are the position

  Model(Index n, Index n_u, Index n_p) : n(n), n_u(n_u), n_p(n_p) {}
  virtual ~Model() = default;
  virtual void terms(States x, Matrix<double> f, Cube<double> g) const = 0;  // f (N, n), g (N, n, n_u)
  virtual void jacobians(States x, Cube<double> out) const = 0;              // ∂f/∂x (N, n, n)
  virtual void steps(States x, States u, double dt, Matrix<double> after) const = 0;  // x after dt [s]
  virtual void brakes(States x, double dt, Matrix<double> u) const = 0;  // inputs that stop the plants within dt
};

// ẋ = u.
struct SingleIntegrator final : Model {
  explicit SingleIntegrator(Index n) : Model(n, n, n) {}
  void terms(States x, Matrix<double> f, Cube<double> g) const override {
    std::fill_n(f.data, x.rows * n, 0.0);
    std::fill_n(g.data, x.rows * n * n, 0.0);
    for (Index i = 0; i < x.rows; ++i)
      for (Index j = 0; j < n; ++j) g(i, j, j) = 1.0;
  }
  void jacobians(States x, Cube<double> out) const override { std::fill_n(out.data, x.rows * n * n, 0.0); }
  void steps(States x, States u, double dt, Matrix<double> after) const override {
    for (Index k = 0; k < x.rows * n; ++k) after.data[k] = x.data[k] + dt * u.data[k];
  }
  void brakes(States x, double, Matrix<double> u) const override { std::fill_n(u.data, x.rows * n_u, 0.0); }
};

// p̈ = u − c ṗ.
struct DoubleIntegrator final : Model {
  double drag;  // c [1/s]

  DoubleIntegrator(Index n_u, double drag) : Model(2 * n_u, n_u, n_u), drag(drag) {}
  void terms(States x, Matrix<double> f, Cube<double> g) const override {
    std::fill_n(g.data, x.rows * n * n_u, 0.0);
    for (Index i = 0; i < x.rows; ++i) {
      reduced_order::damped_drift(x[i], drag, f[i]);
      for (Index j = 0; j < n_u; ++j) g(i, n_u + j, j) = 1.0;
    }
  }
  void jacobians(States x, Cube<double> out) const override {
    std::fill_n(out.data, x.rows * n * n, 0.0);
    for (Index i = 0; i < x.rows; ++i)
      for (Index j = 0; j < n_u; ++j) out(i, j, n_u + j) = 1.0, out(i, n_u + j, n_u + j) = -drag;
  }
  void steps(States x, States u, double dt, Matrix<double> after) const override {
    for (Index i = 0; i < x.rows; ++i) reduced_order::damped_step(x[i], u[i], dt, drag, after[i]);
  }
  void brakes(States x, double dt, Matrix<double> u) const override {
    for (Index i = 0; i < x.rows; ++i)
      for (Index j = 0; j < n_u; ++j) u(i, j) = (drag - 1.0 / dt) * x(i, n_u + j);
  }
};

// x = (p, θ), u = (speed, turn rate).
struct Unicycle final : Model {
  Unicycle() : Model(3, 2, 2) {}
  void terms(States x, Matrix<double> f, Cube<double> g) const override {
    std::fill_n(f.data, x.rows * n, 0.0);
    for (Index i = 0; i < x.rows; ++i) vehicles::unicycle_inputs(x[i].data, g[i].data);
  }
  void jacobians(States x, Cube<double> out) const override { std::fill_n(out.data, x.rows * n * n, 0.0); }
  void steps(States x, States u, double dt, Matrix<double> after) const override {
    for (Index i = 0; i < x.rows; ++i) vehicles::unicycle_step(x[i].data, u[i].data, dt, after[i].data);
  }
  void brakes(States x, double, Matrix<double> u) const override { std::fill_n(u.data, x.rows * n_u, 0.0); }
};

// x = (p, θ, v), u = (a, β).
struct KinematicBicycle final : Model {
  double rear;  // ℓ_r [m]

  explicit KinematicBicycle(double rear) : Model(4, 2, 2), rear(rear) {}
  void terms(States x, Matrix<double> f, Cube<double> g) const override {
    for (Index i = 0; i < x.rows; ++i) {
      vehicles::bicycle_rate(x[i].data, 0.0, 0.0, rear, f[i].data);
      vehicles::bicycle_inputs(x[i].data, rear, g[i].data);
    }
  }
  void jacobians(States x, Cube<double> out) const override {
    std::fill_n(out.data, x.rows * n * n, 0.0);
    for (Index i = 0; i < x.rows; ++i) {
      const double cos = std::cos(x(i, 2)), sin = std::sin(x(i, 2)), v = x(i, 3);
      out(i, 0, 2) = -v * sin, out(i, 0, 3) = cos;
      out(i, 1, 2) = v * cos, out(i, 1, 3) = sin;
    }
  }
  void steps(States x, States u, double dt, Matrix<double> after) const override {
    for (Index i = 0; i < x.rows; ++i) vehicles::bicycle_step(x[i].data, u[i].data, dt, rear, after[i].data);
  }
  void brakes(States x, double dt, Matrix<double> u) const override {
    for (Index i = 0; i < x.rows; ++i) u(i, 0) = -x(i, 3) / dt, u(i, 1) = 0.0;
  }
};

}  // namespace hcbf::model
