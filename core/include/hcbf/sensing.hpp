// What the sensors report of a true state, with all their errors.
#pragma once
#include <cmath>

#include <hcbf/constants.hpp>
#include <hcbf/feet.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/matrices.hpp>
#include <hcbf/rotation.hpp>

namespace hcbf::sensing {

using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;

struct Noise {  // standard normal numbers that one tick takes
  Vector2 drift, fix;
  Vector3 rotation, gyroscope, accelerometer;
  double angle[12], rate[12];
  Vector2 slip;
  double contact[4];
};

struct Errors {
  double timestep;    // [s]
  double fix;         // σ of a fix's white noise [m]
  double drift;       // σ of its slow error [m]
  double keep_drift;  // e^(−dt/τ)
  Vector3 rotation;   // σ of the orientation's error about the world's axes [rad]
  double keep_rotation;
  double slip;  // σ of leg odometry's slow error [m/s]
  double keep_slip;
  double gyroscope;      // σ of a reading [rad/s]
  double accelerometer;  // σ of a reading [m/s²]
  double angle;          // σ of a joint's angle [rad]
  double rate;           // σ of a joint's rate [rad/s]
  double contact;        // a standard normal number above it flips a contact
};

struct Slow {  // errors that last
  Vector2 drift;
  Vector3 rotation;
  Vector2 slip;
};

// Draws the slow errors from their distribution in the long run.
inline void start_slow_errors(const Errors& errors, Slow& slow, const Noise& noise) {
  for (int i = 0; i < 2; ++i) slow.drift[i] = errors.drift * noise.drift[i];
  for (int i = 0; i < 3; ++i) slow.rotation[i] = errors.rotation[i] * noise.rotation[i];
  for (int i = 0; i < 2; ++i) slow.slip[i] = errors.slip * noise.slip[i];
}

inline void relax(Vector2& value, double keep, double deviation, const Vector2& noise) {
  const double spread = std::sqrt(1.0 - keep * keep) * deviation;
  for (int i = 0; i < 2; ++i) value[i] = keep * value[i] + spread * noise[i];
}

// Moves the slow errors on by one tick: e' = k e + √(1 − k²) σ w.
inline void move_slow_errors(const Errors& errors, Slow& slow, const Noise& noise) {
  relax(slow.drift, errors.keep_drift, errors.drift, noise.drift);
  relax(slow.slip, errors.keep_slip, errors.slip, noise.slip);
  const double spread = std::sqrt(1.0 - errors.keep_rotation * errors.keep_rotation);
  for (int i = 0; i < 3; ++i) {
    slow.rotation[i] *= errors.keep_rotation;
    slow.rotation[i] += spread * errors.rotation[i] * noise.rotation[i];
  }
}

// Fills in orientation, rates, joints and contacts as sensors report them. Position and velocity of the
// trunk are copied; no sensor shows them.
inline void sense(const Errors& errors, const Slow& slow, const Noise& noise, const RobotState& truth,
                  RobotState& sensed) {
  sensed = truth;
  sensed.quaternion = rotation::turned(truth.quaternion, slow.rotation);
  for (int joint = 0; joint < 12; ++joint) {
    sensed.joint_position[joint / 3][joint % 3] += errors.angle * noise.angle[joint];
    sensed.joint_velocity[joint / 3][joint % 3] += errors.rate * noise.rate[joint];
  }
  for (int i = 0; i < 3; ++i) sensed.angular_velocity[i] += errors.gyroscope * noise.gyroscope[i];
  for (int foot = 0; foot < 4; ++foot)
    if (noise.contact[foot] > errors.contact) sensed.contact[foot] = truth.touches(foot) ? 0.0 : 1.0;
}

// The acceleration in the world that accelerometer and orientation give [m/s²].
//
// The accelerometer shows f = Rᵀ(v̇ + g e_z) + n, the mean over the tick; turned back with the sensed
// orientation, an error of tilt leaves a share of gravity in it. `before` is the true velocity of the
// trunk a tick ago [m/s].
inline Vector2 planar_acceleration(const Errors& errors, const Noise& noise, const RobotState& truth,
                                   const Vector3& before, const Matrix3& R_sensed) {
  Vector3 acceleration = (truth.linear_velocity - before) / errors.timestep;
  acceleration[2] += constants::GRAVITY;
  const Vector3 force =
      matrices::apply_transposed(rotation::rotation_matrix(truth.quaternion), acceleration) +
      errors.accelerometer * noise.accelerometer;
  const Vector3 turned_back = matrices::apply(R_sensed, force);
  return {turned_back[0], turned_back[1]};
}

}  // namespace hcbf::sensing
