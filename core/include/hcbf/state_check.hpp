// Why a filter brakes, and which state of a plant is valid: the given one, or the last one, propagated.
//
// A state that is not finite or too far away, of no time or too old is not accepted: the model
// propagates the last one that was, under the input that was applied since.
#pragma once
#include <cmath>
#include <vector>

#include <hcbf/margins.hpp>
#include <hcbf/constants.hpp>
#include <hcbf/plants.hpp>
#include <hcbf/reduced_order.hpp>

namespace hcbf::reason {

// Why a filter brakes, or has raised an alarm: in the order of `WORDS`.
enum Reason : Index {
  NONE, STATE, AGE, CLOCK, BARRIERS, SOLVER, GOAL, INPUT, MOTION, SLIP, LAG, LIFT, RESPONSE, MOVES, UNVERIFIED
};

constexpr Index FIRST_ALARM = INPUT;  // below, the filter brakes for as long as the reason lasts

struct Words {
  const char *name, *text;
};
constexpr Words WORDS[] = {
    {"NONE", ""},
    {"STATE", "the state is not finite, farther away than any place, or of another shape than the model's, or a "
              "differential drive's heading is missing"},
    {"AGE", "the stamp of the state is older than the plant's max_age or more than 0.1 s ahead of the clock, or that "
            "of a scan is not of this clock"},
    {"CLOCK", "the time of the state does not advance"},
    {"BARRIERS", "the barriers, or the rows that they become, are not finite or not barriers"},
    {"SOLVER", "no solver answered"},
    {"GOAL", "guidance finds no path to the goal"},
    {"INPUT", "the environment does not apply what the filter chose: expected no wrapper, delay, hold or gain "
              "between filter and robot, and a model like the plant"},
    {"MOTION", "the position does not move by the velocity: expected both of one robot, at one time, in one frame "
               "and unit, and a period that is the time of a step"},
    {"SLIP", "the robot's feet slide more than on the declared floor"},
    {"LAG", "the robot's torques act later than the declared plant's"},
    {"LIFT", "the robot's legs carry more or less than the declared load and motors"},
    {"RESPONSE", "the robot does not do what it is commanded: expected it to follow as its response was measured, or "
                 "within 0.4 s where it was not, on the declared floor, and odometry of that robot that is up to date"},
    {"MOVES", "a region is nearer than its declared velocity explains: expected its velocity [m/s], such as "
              "Disc(…, velocity=(vx, vy)), or the error of its position [m], "
              "Plant(uncertainty=Uncertainty(distance=…))"},
    {"UNVERIFIED", "no manoeuvre of the gatekeeper satisfies the strict conditions from this state on, as after a "
                   "jump, a reset or a change of regions"},
};

// Whether an alarm lasts until the next reset. MOVES, of the world, and UNVERIFIED are decided at every step.
constexpr bool lasts(Index reason) { return reason >= FIRST_ALARM && reason != MOVES && reason != UNVERIFIED; }

}  // namespace hcbf::reason

namespace hcbf::state_check {

using constants::FARTHEST;

constexpr double ROUNDING = 1e-6;  // of a covariance: how far its correlations may be from those of one
constexpr double SAME = 1e-9;      // by how much a covariance that does not grow may differ from that before
constexpr Index ON_STACK = 16;     // up to so many states nothing is allocated

// What is given of one plant, and the state that was accepted last.
struct State {
  Vector<double> x;           // (n,) as the rows read it
  Vector<double> model;       // (n,) the reduced-order model's own
  Vector<double> lag;         // (n,) the body's minus the model's
  Matrix<double> covariance;  // (n, n) of x
  Vector<double> accepted;    // (n,) the last that was
};

// The same of N plants.
struct States {
  Matrix<double> x, model, lag;
  Cube<double> covariance;
  Matrix<double> accepted;
  State operator[](Index i) const { return {x[i], model[i], lag[i], covariance[i], accepted[i]}; }
};

// Returns whether no entry is beyond `FARTHEST`; of what is not finite that is false, too.
inline bool are_near(Vector<const double> values) {
  for (const double value : values)
    if (!(std::abs(value) <= FARTHEST)) return false;
  return true;
}

// Returns whether a matrix (n, n) is symmetric without negative eigenvalues, up to rounding: it is
// zero, or the correlations that are left of it have a Cholesky factor.
inline bool is_covariance(Matrix<const double> matrix) {
  const Index n = matrix.rows;
  bool zero = true;
  for (Index k = 0; k < n * n; ++k) zero &= matrix.data[k] == 0.0;
  if (zero) return true;  // the truth
  for (Index j = 0; j < n; ++j)
    if (!(matrix(j, j) >= 0.0 && std::isfinite(matrix(j, j)))) return false;
  double small[ON_STACK * ON_STACK];
  std::vector<double> large(n > ON_STACK ? n * n : 0);
  const Matrix<double> rest{n > ON_STACK ? large.data() : small, n, n};
  for (Index j = 0; j < n; ++j)
    for (Index k = 0; k < n; ++k) {
      const double size = std::sqrt(matrix(j, j)) * std::sqrt(matrix(k, k));
      if (!(std::abs(matrix(j, k)) <= (1.0 + ROUNDING) * size)) return false;
      if (!(std::abs(matrix(j, k) - matrix(k, j)) <= ROUNDING * size)) return false;
      rest(j, k) = size > 0.0 ? matrix(j, k) / size : 0.0;
    }
  for (Index j = 0; j < n; ++j) {
    const double pivot = rest(j, j);
    if (pivot < -ROUNDING * n) return false;
    for (Index k = j + 1; k < n; ++k) {
      if (pivot <= ROUNDING * n) {
        if (std::abs(rest(k, j)) > std::sqrt(ROUNDING) * n) return false;
        continue;
      }
      const double factor = rest(k, j) / pivot;
      for (Index i = j + 1; i < n; ++i) rest(k, i) -= factor * rest(j, i);
    }
  }
  return true;
}

// Returns why a state is not accepted, 0 if it is; one that is accepted is remembered, and one after
// none is a change.
inline Index look(plants::Plant& plant, const State& state) {
  if (plant.has_model == 0) copy(state.x, state.model);
  Index why = plant.fault < reason::FIRST_ALARM ? plant.fault : 0;
  const bool is_sound = are_near(state.x) && are_near(state.model) && are_near(state.lag) &&
                        is_covariance(state.covariance) && std::abs(plant.heading) <= FARTHEST;
  if (why == 0 && !is_sound) why = reason::STATE;
  if (why == 0 && !std::isfinite(plant.time)) why = reason::CLOCK;
  const bool has_clock = plant.elapsed > 0.0 || plant.time != 0.0;
  if (why == 0 && plant.known && plant.time <= plant.accepted_at && has_clock) why = reason::CLOCK;
  if (why != 0) {
    plant.follows = 0;
    return why;
  }
  if (plant.follows == 0) plant.judged.change = conclusion::CHANGED;
  copy(state.x, state.accepted);
  plant.accepted_at = plant.time;
  plant.known = 1;
  return 0;
}

// Writes the state that was accepted last, which the model has propagated, for the present.
inline void replace(plants::Plant& plant, const State& state) {
  copy(state.accepted, state.x);
  copy(state.accepted, state.model);
  for (Index k = 0; k < state.lag.size; ++k) state.lag[k] = 0.0;
  for (Index k = 0; k < state.covariance.rows * state.covariance.columns; ++k) state.covariance.data[k] = 0.0;
  plant.time = plant.accepted_at;
}

// Notes by how much the velocity's covariance grows in one period; a fix does not change that. Of a
// sample that follows none all of it is taken, as nothing is known of how it grows. One that is the
// same as before does not grow.
inline void grow(plants::Plant& plant, Index follows) {
  double* vague = plant.vague;
  if (follows == 0) vague[0] = vague[1] = vague[2] = plant.growth = 0.0;
  const double xx = plant.covariance[2][2], xy = plant.covariance[2][3], yy = plant.covariance[3][3];
  if (xx + yy + vague[0] + vague[2] == 0.0) return;  // the truth, as before
  const double changed = std::abs(xx - vague[0]) + std::abs(xy - vague[1]) + std::abs(yy - vague[2]);
  const double grown = margins::growth_of({plant.covariance[0], 4, 4}, {vague, 3});
  if (grown > 0.0 || changed <= SAME * (xx + yy)) plant.growth = grown;
  vague[0] = xx, vague[1] = xy, vague[2] = yy;
}

// Returns why a planar double integrator is not accepted, 0 if it is; then its model propagates.
// `input`: (2,) applied since the last sample.
inline Index check(plants::Plant& plant, Vector<const double> input) {
  const State state{{plant.x, 4}, {plant.model, 4}, {plant.lag, 4}, {plant.covariance[0], 4, 4},
                    {plant.accepted, 4}};
  const Index follows = plant.follows;
  const Index why = look(plant, state);
  if (why == 0) {
    grow(plant, follows);
    return 0;
  }
  if (plant.known && plant.elapsed > 0.0) {
    const auto after =
        reduced_order::double_integrator_step({plant.accepted, 4}, input, plant.elapsed, INFINITY);
    plant.known = are_near({after.data(), 4});
    if (plant.known) copy({after.data(), 4}, state.accepted);
  }
  replace(plant, state);
  return why;
}

// Looks at N plants of any model, writes the reasons, and returns whether there is one.
// `velocity_at`: where x holds the planar velocity, -1 for nowhere.
inline bool check_all(Records<plants::Plant> sensed, const States& states, Index velocity_at,
                        Records<report::Plant> told) {
  bool some = false;
  for (Index i = 0; i < sensed.size; ++i) {
    plants::Plant& plant = sensed[i];
    const State state = states[i];
    told[i].reason = look(plant, state);
    some |= told[i].reason != 0;
    for (Index k = 0; k < 2; ++k)  // what is known of a speed, whatever the model
      plant.x[2 + k] = velocity_at < 0 ? INFINITY : state.x[velocity_at + k];
  }
  return some;
}

// Writes the states that models propagated where plants are not accepted.
inline void replace_all(Records<plants::Plant> sensed, const States& states, Records<report::Plant> told) {
  for (Index i = 0; i < sensed.size; ++i)
    if (told[i].reason != 0) replace(sensed[i], states[i]);
}

// Notes by how much the covariance of the drift (N, k, k) grows in one period, before this sample is
// remembered; see `grow`. `n_p`: how many states are the position.
inline void grow_all(Records<plants::Plant> sensed, Records<report::Plant> told, Cube<const double> drift,
                     Index n_p) {
  for (Index i = 0; i < sensed.size; ++i) {
    if (told[i].reason != 0) continue;
    plants::Plant& plant = sensed[i];
    for (Index j = 0; j < 2; ++j)
      for (Index k = 0; k < 2; ++k) plant.covariance[2 + j][2 + k] = n_p == 2 ? drift(i, j, k) : 0.0;
    if (n_p != 2) plant.covariance[2][2] = plant.covariance[3][3] = margins::worst(drift[i], n_p);
    grow(plant, plant.follows);
  }
}

}  // namespace hcbf::state_check
