// Rows of any model, for N states at once. A jet says how h bends, the model how the state moves. With
// ψ₀ = h − m, whose rate is ∂h/∂t − ṁ,
//
//     ψ₁ = dψ₀/dt + α₁(ψ₀),     ∇ψ₁ = ∇²h f + (∂f/∂x)ᵀ ∇h + ∂∇h/∂t + α₁'(ψ₀) ∇h.
#pragma once
#include <vector>

#include <hcbf/rows.hpp>
#include <hcbf/shape_terms.hpp>

namespace hcbf::general_rows {

using class_k::ClassK;
using rows::ALPHA2_PSI, rows::B, rows::H, rows::PSI;

// Where a row that is made for any model has its numbers, behind those of `rows`: those of `margins`,
// what it reserves besides, how well it is conditioned, and 1 where its barrier reads the position.
// a (n_u,) follows.
constexpr int MARGIN = 4, RATE = 5, QUICKENING = 6, USABLE = 7, REACH = 8, FAST = 9, DIP = 10,
              CONDITIONING = 11, PLACED = 12, WIDTH = 13;

constexpr Index ELSEWHERE = -1;     // the kind of a barrier whose row is made elsewhere: a function
constexpr double VANISHED = 1e-9;   // a row that no input changes by more of its size is a constant

struct Scene {  // the barriers of N scenes
  Matrix<const Index> kind;       // (N, m) as `layout` has it, `NONE` behind a shorter scene; or `ELSEWHERE`
  Cube<const double> parameters;  // (N, m, WIDTH) the blocks of built-in ones
  Matrix<const Index> degree;     // (N, m) the derivative of h that an input enters first, 1 or 2
};

struct Terms {  // a model at N states
  Matrix<const double> f;       // (N, n)
  Cube<const double> g;         // (N, n, n_u)
  Cube<const double> jacobian;  // (N, n, n) ∂f/∂x; (N, 0, 0) where every degree is 1
};

// What a jet says of h at a state that moves by f.
struct Rates {
  double h;     // h
  double rate;  // ∂h/∂t
  double bent;  // ∂∇h/∂t·f + ∂²h/∂t²
};

// Writes ∇h (n,) and ∇²h f + ∂∇h/∂t (n,) of a built-in barrier.
inline Rates built_in_rates(Index kind, const double* c, Vector<const double> x, double t,
                            Vector<const double> f, double* gradient, double* turned) {
  std::fill_n(gradient, x.size, 0.0), std::fill_n(turned, x.size, 0.0);
  if (kind == layout::SPEED_LIMIT) {
    const double v_max = c[layout::V_MAX];
    for (int j = 2; j < 4; ++j) gradient[j] = -x[j] / v_max, turned[j] = -f[j] / v_max;
    return {speed_limit::value(v_max, x[2], x[3]), 0.0, 0.0};
  }
  const PlanarJet at = shape_terms::jet(kind, c, x[0], x[1], t);
  const double wx = c[layout::VELOCITY_X], wy = c[layout::VELOCITY_Y];
  gradient[0] = at.gx, gradient[1] = at.gy;
  const double bend = (at.tx * (f[0] - wx) + at.ty * (f[1] - wy)) / at.distance;  // ∇²h = t tᵀ / d
  turned[0] = bend * at.tx, turned[1] = bend * at.ty;
  return {at.h, -(at.gx * wx + at.gy * wy), -bend * (at.tx * wx + at.ty * wy)};
}

// The same of a user's own barrier, whose jet was packed: h, ∂h/∂t, ∂²h/∂t², ∇h, ∂∇h/∂t and ∇²h.
inline Rates own_rates(const double* jet, Vector<const double> f, double* gradient, double* turned) {
  const Index n = f.size;
  double bent = jet[2];
  for (Index j = 0; j < n; ++j) {
    gradient[j] = jet[3 + j], turned[j] = jet[3 + n + j];
    bent += jet[3 + n + j] * f[j];
    for (Index q = 0; q < n; ++q) turned[j] += jet[3 + (2 + j) * n + q] * f[q];
  }
  return {jet[0], jet[1], bent};
}

// Writes L_g ψ (n_u,), and returns the row's conditioning ‖L_g ψ‖ / (‖∇ψ‖ ‖g‖), of which `size` is the
// divisor's square. A row that no input changes is a constant, of conditioning 0.
inline double in_inputs(const double* gradient, Matrix<const double> g, double size, double* a) {
  double reached = 0.0;
  for (Index j = 0; j < g.columns; ++j) {
    a[j] = 0.0;
    for (Index q = 0; q < g.rows; ++q) a[j] += gradient[q] * g(q, j);
    reached += a[j] * a[j];
  }
  const double share = size > 0.0 ? std::sqrt(reached / size) : 0.0;
  if (share > VANISHED) return share;
  std::fill_n(a, g.columns, 0.0);
  return 0.0;
}

// Writes the rows a·u ≥ b of N states, and returns whether a ψ₁ of one is below zero.
//
// jets (N, m, 3 + 2n + n²) of users' own barriers, (N, 0, …) where there are none; x (N, n) and t (N,)
// [s]; out (N, m, WIDTH + n_u) with m, ṁ and m̈, see `MARGIN`; the rest is written.
inline bool write_rows(const Scene& scene, Cube<const double> jets, Matrix<const double> x,
                       Vector<const double> t, const Terms& terms, const ClassK& alpha1, const ClassK& alpha2,
                       const ClassK& alpha_speed, Cube<double> out) {
  const Index n = x.columns;
  std::vector<double> space(2 * n);
  double *gradient = space.data(), *turned = gradient + n;
  bool lags = false;
  for (Index i = 0; i < x.rows; ++i) {
    const Vector<const double> f = terms.f[i];
    const Matrix<const double> g = terms.g[i];
    double steer = 0.0;
    for (Index q = 0; q < n * g.columns; ++q) steer += g.data[q] * g.data[q];
    for (Index k = 0; k < scene.kind.columns; ++k) {
      const Index kind = scene.kind(i, k);
      if (kind == ELSEWHERE || kind == layout::NONE) continue;
      double* row = out[i][k].data;
      const auto [h, h_rate, bent] =
          kind == layout::CUSTOM
              ? own_rates(jets[i][k].data, f, gradient, turned)
              : built_in_rates(kind, scene.parameters[i][k].data, x[i], t[i], f, gradient, turned);
      double psi = h - row[MARGIN], rate = h_rate - row[RATE];
      if (scene.degree(i, k) == 2) {
        const double slope = class_k::slope(alpha1, psi);
        double along_f = 0.0;
        for (Index j = 0; j < n; ++j) along_f += gradient[j] * f[j];
        const double h_dot = along_f + rate;
        rate = bent - row[QUICKENING] + slope * rate;
        for (Index j = 0; j < n; ++j)
          for (Index q = 0; q < n; ++q) turned[j] += terms.jacobian(i, q, j) * gradient[q];
        for (Index j = 0; j < n; ++j) gradient[j] = turned[j] + slope * gradient[j];
        psi = h_dot + class_k::value(alpha1, psi);
        lags |= psi < 0.0;
      }
      double along = 0.0, whole = 0.0;
      for (Index j = 0; j < n; ++j) along += gradient[j] * f[j], whole += gradient[j] * gradient[j];
      row[CONDITIONING] = in_inputs(gradient, g, whole * steer, row + WIDTH);
      const double alpha2_psi = class_k::value(kind == layout::SPEED_LIMIT ? alpha_speed : alpha2, psi);
      row[B] = -alpha2_psi - along - rate, row[H] = h;
      row[ALPHA2_PSI] = alpha2_psi, row[PSI] = psi;
    }
  }
  return lags;
}

// Lets a row of degree 2 request a stop where ψ₁ is below zero. `most`: of a·u in U.
inline void recover(const ClassK& alpha1, const ClassK& alpha2, double most, double* row) {
  const double kept = row[H] - row[MARGIN];
  const double rate = class_k::inverse(alpha2, row[ALPHA2_PSI]) - class_k::value(alpha1, kept);
  const double lost = row[B] + row[ALPHA2_PSI] + class_k::slope(alpha1, kept) * rate;
  row[B] = std::max(row[B], rows::late(kept, rate, lost, most));
}

// Writes rows of functions, and returns whether a ψ₁ of one is below zero.
//
// made (N, m, n_u + 5): a, b, h, α₂(ψ), conditioning and early inputs; degrees (m,) of the functions;
// out (N, m, WIDTH + n_u) is written.
inline bool take_rows(Cube<const double> made, Vector<const Index> degrees, const ClassK& alpha2,
                      Cube<double> out) {
  bool lags = false;
  const Index n_u = made.columns - 5;
  for (Index i = 0; i < made.layers; ++i)
    for (Index k = 0; k < made.rows; ++k) {
      const double* one = made[i][k].data;
      double* row = out[i][k].data;
      row[B] = one[n_u], row[H] = one[n_u + 1], row[ALPHA2_PSI] = one[n_u + 2];
      if (degrees[k] == 2) row[B] += row[QUICKENING];
      row[PSI] = class_k::inverse(alpha2, one[n_u + 2]);
      row[CONDITIONING] = one[n_u + 3];
      std::copy_n(one, n_u, row + WIDTH);
      lags |= degrees[k] == 2 && row[PSI] < 0.0;
    }
  return lags;
}

}  // namespace hcbf::general_rows
