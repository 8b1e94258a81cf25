// One tick of the estimator: sense, predict, take in the feet, and a fix when it arrives.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstring>

#include <hcbf/arrays.hpp>
#include <hcbf/kalman.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/leg_odometry.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/matrices.hpp>
#include <hcbf/rotation.hpp>
#include <hcbf/sensing.hpp>

namespace hcbf::estimation_tick {

using kalman::AXIS;
using kalman::COLUMNS;
using leg::LegGeometry;
using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;
using sensing::Errors;
using sensing::Noise;

// a foot that disagrees with the estimate by more standard deviations slips or lifts
constexpr double GATE = 3.5;
constexpr double ROLLING = 0.01;  // standard deviation of what a standing foot does between two ticks [m/s]

struct Settings {
  kalman::Model model;
  Errors errors;
  LegGeometry legs;
  double foot_radius;  // [m]
  Index settled;       // ticks of contact before a foot counts
  Index period;        // ticks between fixes
  Index delay;         // ticks from a fix to its arrival
  double start;        // variance of the white noise of the first position [m²]
};

struct Memory {
  Index ticks;        // since the reset
  Vector3 velocity;   // true, a tick ago [m/s]
  Index touching[4];  // ticks that each foot has been reported in contact
  sensing::Slow slow;
  double yaw;  // [rad]
};

struct Past {  // an instant that a fix still to come may change: what was known then, and what came in
  double fix[COLUMNS];           // taken at this instant [m]
  double acceleration[COLUMNS];  // that led to it [m/s²]
  double odometry[COLUMNS];      // [m/s]
  double var_odometry;           // negative where no foot stood
  kalman::Means x;
  kalman::Covariance cov;
};

// The entry of an instant, from the ring that `past` is.
inline Past& instant(Vector<Past> past, Index ticks) { return past[ticks % past.size]; }

// Writes the estimated planar position and velocity into a state.
inline void tell(const kalman::Means& x, RobotState& told) {
  for (int axis = 0; axis < 2; ++axis) {
    told.position[axis] = x[kalman::P][axis];
    told.linear_velocity[axis] = x[kalman::V][axis];
  }
}

// Writes a measured vector into columns, and how an error of the heading turns it.
inline void put_turned(const Vector2& measured, double (&columns)[COLUMNS]) {
  columns[0] = measured[0];
  columns[1] = measured[1];
  columns[2] = -measured[1];
  columns[3] = measured[0];
}

// Begins an episode at rest, with a position averaged over fixes; `told` is what is known of the robot.
inline void start(const Settings& settings, Memory& memory, Vector<Past> past, const RobotState& truth,
                  const Noise& noise, RobotState& told) {
  using kalman::D, kalman::P;
  memory.ticks = 0;
  memory.velocity = truth.linear_velocity;
  std::fill(memory.touching, memory.touching + 4, 0);
  sensing::start_slow_errors(settings.errors, memory.slow, noise);
  sensing::sense(settings.errors, memory.slow, noise, truth, told);
  memory.yaw = rotation::yaw_of(rotation::rotation_matrix(told.quaternion));
  Past& first = past[0];
  std::memset(first.x, 0, sizeof first.x);
  std::memset(first.cov, 0, sizeof first.cov);
  for (int axis = 0; axis < 2; ++axis) {
    const double error = memory.slow.drift[axis] + std::sqrt(settings.start) * noise.fix[axis];
    first.x[P][axis] = truth.position[axis] + error;
  }
  for (int i = D; i < AXIS; ++i) first.cov[i][i] = settings.model.variance[i];
  first.cov[P][P] = settings.start + settings.model.variance[D];
  first.cov[P][D] = first.cov[D][P] = -settings.model.variance[D];
  tell(first.x, told);
}

inline void advance(const Settings& settings, const Past& before, Past& entry) {
  std::memmove(entry.x, before.x, sizeof entry.x);
  std::memmove(entry.cov, before.cov, sizeof entry.cov);
  const double sigma = settings.errors.accelerometer;
  kalman::predict(settings.model, entry.x, entry.cov, entry.acceleration, sigma * sigma);
}

inline void take_odometry(Past& entry) {
  if (entry.var_odometry > 0.0)
    kalman::correct(entry.x, entry.cov, kalman::V, kalman::S, entry.odometry, entry.var_odometry);
}

// Notes the mean over the feet that have settled and agree with the prediction in `entry`.
inline void average_feet(const Settings& settings, const Memory& memory, const RobotState& state,
                         const Matrix3& R, Past& entry) {
  using kalman::S, kalman::V;
  const double var_rate = settings.errors.rate * settings.errors.rate;
  const auto& cov = entry.cov;
  const double *v = entry.x[V], *slip = entry.x[S];
  const double heading = settings.errors.rotation[2];
  const double sideways = heading * heading * (v[0] * v[0] + v[1] * v[1]);
  const double uncertain = cov[V][V] + 2.0 * cov[V][S] + cov[S][S] + sideways;
  Vector2 total = {{0.0, 0.0}};
  double variance = 0.0;
  int count = 0;
  const auto feet = leg::foot_kinematics(settings.legs, state.joint_position, state.joint_velocity);
  for (int leg = 0; leg < 4; ++leg) {
    if (memory.touching[leg] < settings.settled) continue;
    const auto foot = leg_odometry::trunk_velocity(feet, settings.foot_radius, leg, state, R);
    const double noise = var_rate * foot.gain + ROLLING * ROLLING;
    Vector2 velocity, gap;
    for (int axis = 0; axis < 2; ++axis) {
      velocity[axis] = foot.velocity[axis] + memory.slow.slip[axis];
      gap[axis] = velocity[axis] - v[axis] - slip[axis];
    }
    if (gap[0] * gap[0] + gap[1] * gap[1] <= GATE * GATE * (uncertain + noise)) {
      for (int axis = 0; axis < 2; ++axis) total[axis] += velocity[axis];
      variance += noise;
      ++count;
    }
  }
  entry.var_odometry = -1.0;
  if (count) {
    put_turned({total[0] / count, total[1] / count}, entry.odometry);
    entry.var_odometry = variance / (count * count);
  }
}

// Takes in the fix of tick `taken`, and plays again what came in since, up to tick `now`.
inline void take_fix(const Settings& settings, Vector<Past> past, Index taken, Index now) {
  Past* entry = &instant(past, taken);
  kalman::correct(entry->x, entry->cov, kalman::P, kalman::D, entry->fix, settings.model.fix);
  for (Index k = taken + 1; k <= now; ++k) {
    Past& following = instant(past, k);
    advance(settings, *entry, following);
    take_odometry(following);
    entry = &following;
  }
}

// Moves the estimate on by one tick; arguments as in `start`.
inline void tick(const Settings& settings, Memory& memory, Vector<Past> past, const RobotState& truth,
                 const Noise& noise, RobotState& told) {
  const Errors& errors = settings.errors;
  const Past& before = instant(past, memory.ticks);
  memory.ticks += 1;
  Past& entry = instant(past, memory.ticks);
  sensing::move_slow_errors(errors, memory.slow, noise);
  sensing::sense(errors, memory.slow, noise, truth, told);
  const Matrix3 R = rotation::rotation_matrix(told.quaternion);
  memory.yaw = rotation::yaw_of(R);

  put_turned(sensing::planar_acceleration(errors, noise, truth, memory.velocity, R), entry.acceleration);
  for (int axis = 0; axis < 2; ++axis) {
    entry.fix[axis] = truth.position[axis] + memory.slow.drift[axis] + errors.fix * noise.fix[axis];
    entry.fix[2 + axis] = 0.0;
  }
  memory.velocity = truth.linear_velocity;
  for (int foot = 0; foot < 4; ++foot)
    memory.touching[foot] = told.touches(foot) ? memory.touching[foot] + 1 : 0;

  advance(settings, before, entry);
  average_feet(settings, memory, told, R, entry);
  take_odometry(entry);
  const Index delayed = memory.ticks - settings.delay;
  if (delayed > 0 && delayed % settings.period == 0) take_fix(settings, past, delayed, memory.ticks);
  tell(entry.x, told);
}

}  // namespace hcbf::estimation_tick
