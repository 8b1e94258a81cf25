// Margins of the rows of N plants of any model; `margins` has the equation.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/general_rows.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/shape_terms.hpp>
#include <hcbf/model.hpp>

namespace hcbf::model_margins {

// What is not known of N plants; the fields from `off` on are those of `margins::Unknown`.
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

// Writes of rows (N, m, WIDTH + n_u) what they reserve, from `general_rows::MARGIN` to `FAST`: m, ṁ, m̈,
// usable, by how much the body's reach lowers h, and 1 where the body is faster than a speed limit.
// `period`: T [s], 0 where it is unknown; `slope` (n,) is written to.
inline void of_models(const Uncertainty& settings, const Rows& rows, const Several& several, double period,
                      Vector<double> slope, Cube<double> out) {
  const Index n = several.x.columns, inputs = several.x.rows > 0 ? several.turns.layers / several.x.rows : 0;
  for (Index i = 0; i < several.x.rows; ++i) {
    const double *x = several.x[i].data, *lag = several.lag[i].data;
    const Matrix<const double> covariance = several.state[i];
    for (Index k = 0; k < rows.kind.columns; ++k) {
      const Vector<double> row = out[i][k].part(general_rows::MARGIN, general_rows::FAST + 1);
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
          std::copy_n(rows.gradient[i][k].data, n, slope.data);
        }
        const margins::Unknown unknown{
            several.off[i], {lag, placed},     several.slip[i],
            covariance,     several.drift[i],  several.growth[i],
            several.turns.part(i * inputs, (i + 1) * inputs)};
        const margins::Row found = margins::of_row(settings, unknown, slope, kind, period);
        row[margins::MARGIN] = found.margin, row[margins::RATE] = found.rate;
        row[margins::QUICKENING] = found.quickening, row[margins::USABLE] = found.usable;
        row[margins::REACH] = found.steep * settings.body;
        if (kind == ConvexPolygon::CODE) row[margins::USABLE] += ConvexPolygon::used(c.data);
      }
      row[margins::MARGIN] += rows.least(i, k) + rows.bend(i, k);
    }
  }
}

// Turns a symmetric matrix (n, n) to a diagonal one, whose entries are its eigenvalues, and writes its
// eigenvectors into the columns of `vectors` (cyclic Jacobi).
inline void diagonalise(Matrix<double> a, Matrix<double> vectors) {
  constexpr int MOST_SWEEPS = 30;
  const Index n = a.rows;
  std::fill_n(vectors.data, n * n, 0.0);
  for (Index j = 0; j < n; ++j) vectors(j, j) = 1.0;
  bool still = false;
  for (int sweep = 0; sweep < MOST_SWEEPS && !still; ++sweep) {
    still = true;
    for (Index p = 0; p < n; ++p)
      for (Index q = p + 1; q < n; ++q) {
        if (std::abs(a(p, q)) <= 1e-18 * (std::abs(a(p, p)) + std::abs(a(q, q)))) continue;
        still = false;
        const double twist = (a(q, q) - a(p, p)) / (2.0 * a(p, q));
        const double tan = std::copysign(1.0, twist) / (std::abs(twist) + std::sqrt(1.0 + twist * twist));
        const double cos = 1.0 / std::sqrt(1.0 + tan * tan), sin = tan * cos;
        const auto turn = [=](double& first, double& second) {
          const double kept = first;
          first = cos * kept - sin * second, second = sin * kept + cos * second;
        };
        for (Index k = 0; k < n; ++k) turn(a(k, p), a(k, q));
        for (Index k = 0; k < n; ++k) turn(a(p, k), a(q, k)), turn(vectors(k, p), vectors(k, q));
        a(p, q) = a(q, p) = 0.0;
      }
  }
}

// What the rows of N plants of a model reserve.
class Reserve {
 public:
  // `largest` (n_u,): of each input; `period`: T [s], 0 where it is unknown.
  Reserve(const model::Model& model, const Uncertainty& settings, Vector<const double> largest, double period,
          Index count)
      : settings(settings), period(period), model_(model), largest_(largest.begin(), largest.end()),
        count_(count), time(count), growth(count) {
    const Index n = model.n, n_u = model.n_u, points = 2 * n * count;
    for (auto* each : {&body_, &off_}) each->resize(count * n);
    x_ = lag_ = body_;
    f_.resize(points * n), g_.resize(points * n * n_u);
    f_own_.resize(count * n), g_own_.resize(count * n * n_u);
    slip_.resize(count * (1 + n_u) * n);
    state_.resize(count * n * n), drift_ = state_;
    turns_.resize(count * n_u * n * n);
    points_.resize(points * n), turned_.resize(n * n), vectors_ = turned_, slope_.resize(n);
  }

  // Notes what is not known of N plants: x (N, n) as the rows read it, the models' own states (N, n), the
  // bodies' minus these (N, n), and P (N, n, n). The drift and what inputs do are compared at x ± κ L_j, with
  // P = L Lᵀ.
  void know(Matrix<const double> x, Matrix<const double> own, Matrix<const double> lag,
            Cube<const double> covariance) {
    const Index size = count_ * model_.n;
    std::copy_n(x.data, size, x_.data()), std::copy_n(lag.data, size, lag_.data());
    std::copy_n(covariance.data, size * model_.n, state_.data());
    for (Index k = 0; k < size; ++k) {
      body_[k] = own.data[k] + lag.data[k];
      off_[k] = x.data[k] - body_[k];
    }
    for (auto* each : {&slip_, &drift_, &turns_}) std::fill(each->begin(), each->end(), 0.0);
    if (std::any_of(lag_.begin(), lag_.end(), [](double each) { return each != 0.0; })) compare(own);
    const bool exact = std::all_of(state_.begin(), state_.end(), [](double each) { return each == 0.0; });
    if (!exact && settings.confidence > 0.0) spread();
  }

  // Whether the model answers wherever the margins of plant i ask about it.
  bool is_known(Index i) const {
    const auto are_finite = [i, this](const std::vector<double>& each) {
      const Index size = static_cast<Index>(each.size()) / count_;
      const double* first = each.data() + i * size;
      return std::all_of(first, first + size, [](double one) { return std::isfinite(one); });
    };
    return are_finite(slip_) && are_finite(drift_) && are_finite(turns_);
  }

  Cube<const double> drift() const { return {drift_.data(), count_, model_.n, model_.n}; }

  // Writes of rows what they reserve, see `of_models`.
  void write(const Rows& rows, Cube<double> out) {
    const Index n = model_.n, n_u = model_.n_u;
    const Several several{{x_.data(), count_, n},
                          {time.data(), count_},
                          {lag_.data(), count_, n},
                          {off_.data(), count_, n},
                          {slip_.data(), count_, 1 + n_u, n},
                          {state_.data(), count_, n, n},
                          drift(),
                          {growth.data(), count_},
                          {turns_.data(), count_ * n_u, n, n}};
    of_models(settings, rows, several, period, {slope_.data(), n}, out);
  }

  const Uncertainty settings;
  const double period;  // T [s]

 private:
  // The body's ẋ minus the model's: regions read two states as a position, whatever n_p is.
  void compare(Matrix<const double> own) {
    const Index n = model_.n, n_u = model_.n_u;
    model_.terms({body_.data(), count_, n}, {f_.data(), count_, n}, {g_.data(), count_, n, n_u});
    model_.terms(own, {f_own_.data(), count_, n}, {g_own_.data(), count_, n, n_u});
    const Cube<double> slip{slip_.data(), count_, 1 + n_u, n};
    for (Index i = 0; i < count_; ++i)
      for (Index j = 0; j < n; ++j) {
        const Index at = i * n + j;
        slip(i, 0, j) = f_[at] - f_own_[at];
        for (Index s = 0; s < n_u; ++s)
          slip(i, 1 + s, j) = (g_[at * n_u + s] - g_own_[at * n_u + s]) * largest_[s];
      }
  }

  // The covariances of f and of g(x)u.
  void spread() {
    const Index n = model_.n, n_u = model_.n_u, points = 2 * n * count_;
    const Matrix<double> turned{turned_.data(), n, n}, vectors{vectors_.data(), n, n};
    const double scale = margins::reserved(settings, 1.0);
    for (Index i = 0; i < count_; ++i) {
      std::copy_n(state_.data() + i * n * n, n * n, turned.data);
      diagonalise(turned, vectors);
      for (Index j = 0; j < n; ++j)
        for (Index k = 0; k < n; ++k) {
          const double step = scale * (vectors(k, j) * std::sqrt(std::max(turned(j, j), 0.0)));
          points_[(i * n + j) * n + k] = x_[i * n + k] + step;
          points_[((count_ + i) * n + j) * n + k] = x_[i * n + k] - step;
        }
    }
    model_.terms({points_.data(), points, n}, {f_.data(), points, n}, {g_.data(), points, n, n_u});
    const double apart = 2.0 * scale;
    const Index half = count_ * n * n;
    for (Index i = 0; i < count_; ++i)
      for (Index j = 0; j < n; ++j) {
        const double* at = f_.data() + (i * n + j) * n;
        double* in = g_.data() + (i * n + j) * n * n_u;
        for (Index k = 0; k < n; ++k) vectors_[k] = (at[k] - at[half + k]) / apart;
        add_square(vectors_.data(), drift_.data() + i * n * n);
        for (Index s = 0; s < n_u; ++s) {
          for (Index k = 0; k < n; ++k) {
            const double* one = in + k * n_u + s;
            vectors_[k] = (one[0] - one[half * n_u]) * largest_[s] / apart;
          }
          add_square(vectors_.data(), turns_.data() + (i * n_u + s) * n * n);
        }
      }
  }

  // Adds a aᵀ to a matrix (n, n).
  void add_square(const double* a, double* sum) const {
    for (Index j = 0; j < model_.n; ++j)
      for (Index k = 0; k < model_.n; ++k) sum[j * model_.n + k] += a[j] * a[k];
  }

  const model::Model& model_;
  std::vector<double> largest_;
  Index count_;
  std::vector<double> x_, lag_, body_, off_, f_, g_, f_own_, g_own_, slip_, state_, drift_, turns_;
  std::vector<double> points_, turned_, vectors_, slope_;

 public:
  std::vector<double> time, growth;  // (N,) as `Several` has them
};

}  // namespace hcbf::model_margins
