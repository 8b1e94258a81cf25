// Margins of the rows of N plants of any model; `margins` has the equation.
#pragma once
#include <algorithm>
#include <vector>

#include <hcbf/margins.hpp>

namespace hcbf::model_margins {

// Samples of N plants; the fields from `off` on are those of `margins::Unknown`.
struct Several {
  Matrix<const double> x;     // (N, n) as the rows read it
  Vector<const double> time;  // (N,) [s]
  Matrix<const double> lag;   // (N, n) the body's state minus the model's
  Matrix<const double> off;
  Cube<const double> slip, state, drift;
  Vector<const double> growth;
  Cube<const double> turns;  // (N · S, n, n), S of each plant
};

// The conditions of N plants of any model.
struct Rows {
  Matrix<const Index> kind;       // (N, m); what is no built-in shape has its slope in `gradient`
  Cube<const double> parameters;  // (N, m, WIDTH)
  Matrix<const double> least;     // (N, m) what a row reserves by itself
  Cube<const double> gradient;    // (N, m, n) ∇h of others
  Matrix<const double> bend;      // (N, m) what these may lose in second order
  Index n_p;                      // how many states, from the first on, are the position
};

// Writes (N, m, 6): m, ṁ, m̈, leaning, by how much the body's reach lowers h, and 1 where the body is faster
// than a speed limit. `period`: T [s], 0 where it is unknown.
inline void of_models(const Uncertainty& settings, const Rows& rows, const Several& several, double period,
                      Cube<double> out) {
  const Index n = several.x.columns, inputs = several.x.rows > 0 ? several.turns.layers / several.x.rows : 0;
  std::vector<double> slope(n);
  const Vector<double> gradient{slope.data(), n};
  for (Index i = 0; i < several.x.rows; ++i) {
    const double *x = several.x[i].data, *lag = several.lag[i].data;
    const Matrix<const double> covariance = several.state[i];
    for (Index k = 0; k < rows.kind.columns; ++k) {
      const Vector<double> row = out[i][k];
      const Vector<const double> c = rows.parameters[i][k];
      const Index kind = rows.kind(i, k);
      std::fill_n(row.data, row.size, 0.0);
      if (kind == layout::SPEED_LIMIT) {
        row[margins::MARGIN] = margins::of_speed(settings, lag, covariance);
        row[margins::RATE] = margins::speed_growth(settings, covariance, several.growth[i], period);
        row[margins::FAST] = margins::is_fast(c[layout::V_MAX], x, lag) ? 1.0 : 0.0;
      } else {
        Index placed = rows.n_p;
        if (shape_terms::is_region(kind) && kind >= 0) {
          const auto jet = shape_terms::jet(kind, c.data, x[0], x[1], several.time[i]);
          std::fill(slope.begin(), slope.end(), 0.0);
          slope[0] = jet.gx, slope[1] = jet.gy;
          placed = 2;
        } else {
          std::copy_n(rows.gradient[i][k].data, n, slope.data());
        }
        const margins::Unknown unknown{
            several.off[i], {lag, placed},     several.slip[i],
            covariance,     several.drift[i],  several.growth[i],
            several.turns.part(i * inputs, (i + 1) * inputs)};
        const bool straight = kind == half_plane::CODE;
        const margins::Row found = margins::of_row(settings, unknown, gradient, straight, period);
        row[margins::MARGIN] = found.margin, row[margins::RATE] = found.rate;
        row[margins::QUICKENING] = found.quickening, row[margins::LEANING] = found.leaning;
        row[margins::REACH] = found.steep * settings.body;
        if (kind == convex_polygon::CODE) row[margins::LEANING] += convex_polygon::used(c.data);
      }
      row[margins::MARGIN] += rows.least(i, k) + rows.bend(i, k);
    }
  }
}

}  // namespace hcbf::model_margins
