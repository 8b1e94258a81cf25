// The Kalman filter of one axis of the plane; x and y differ in their means alone.
//
// Both axes have the same model and the same noise, so that they share one covariance. The state of an
// axis is [p, v, d, a, s]: position, velocity, drift of the fix, error of the acceleration, slip of the
// feet.
//
// The filter is linear in what comes in, and its gains do not depend on that. So the same steps, taken on
// the derivatives of what comes in, give the derivative of the estimate: columns beyond the axes.
#pragma once

namespace hcbf::kalman {

enum Entry { P, V, D, A, S, AXIS };
constexpr int COLUMNS = 4;  // the means along x and y, and their derivatives by an error of the heading

using Means = double[AXIS][COLUMNS];
using Covariance = double[AXIS][AXIS];

struct Model {
  double timestep;        // [s]
  double keep[AXIS];      // e^(−dt/τ) of the slow errors; 1 for position and velocity
  double variance[AXIS];  // of the slow errors in the long run
  double fix;             // variance of a fix's white noise [m²]
};

// Moves an estimate on by one tick under a measured acceleration [m/s²] with a white noise of variance
// `var_acc` [m²/s⁴]: v' = v + dt (acc − a), p' = p + dt v', as the physics integrates. The slow errors
// decay and are driven so that their variance stays what it is in the long run.
inline void predict(const Model& model, Means& x, Covariance& cov, const double (&acceleration)[COLUMNS],
                    double var_acc) {
  const double dt = model.timestep;
  const double square = dt * dt;
  for (int axis = 0; axis < COLUMNS; ++axis) {
    const double acc = acceleration[axis] - x[A][axis];
    x[V][axis] += dt * acc;
    x[P][axis] += dt * x[V][axis];
    for (int i = D; i < AXIS; ++i) x[i][axis] *= model.keep[i];
  }
  // F cov, then (F cov) Fᵀ, row by row and column by column
  for (int j = 0; j < AXIS; ++j) {
    cov[P][j] += dt * cov[V][j] - square * cov[A][j];
    cov[V][j] -= dt * cov[A][j];
    for (int i = D; i < AXIS; ++i) cov[i][j] *= model.keep[i];
  }
  for (int i = 0; i < AXIS; ++i) {
    cov[i][P] += dt * cov[i][V] - square * cov[i][A];
    cov[i][V] -= dt * cov[i][A];
    for (int j = D; j < AXIS; ++j) cov[i][j] *= model.keep[j];
  }
  cov[P][P] += square * square * var_acc;
  cov[P][V] += square * dt * var_acc;
  cov[V][P] += square * dt * var_acc;
  cov[V][V] += dt * dt * var_acc;
  for (int i = D; i < AXIS; ++i) cov[i][i] += (1.0 - model.keep[i] * model.keep[i]) * model.variance[i];
}

// Takes in a measurement z of the sum of two entries of the state, on both axes; `variance` is that of its
// white noise.
inline void correct(Means& x, Covariance& cov, int first, int second, const double (&z)[COLUMNS],
                    double variance) {
  double shown[AXIS];
  for (int i = 0; i < AXIS; ++i) shown[i] = cov[i][first] + cov[i][second];
  const double innovation_variance = shown[first] + shown[second] + variance;
  for (int axis = 0; axis < COLUMNS; ++axis) {
    const double surprise = (z[axis] - x[first][axis] - x[second][axis]) / innovation_variance;
    for (int i = 0; i < AXIS; ++i) x[i][axis] += shown[i] * surprise;
  }
  for (int i = 0; i < AXIS; ++i)
    for (int j = 0; j < AXIS; ++j) cov[i][j] -= shown[i] * shown[j] / innovation_variance;
}

}  // namespace hcbf::kalman
