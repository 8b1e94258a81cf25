// From the planar input u to where the trunk shall be: the reduced-order model, run at 500 Hz.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/rotation.hpp>

namespace hcbf::body_reference {

constexpr double LEASH = 0.15;  // [m] the reference never runs further ahead of the robot
// at full grip, and less in proportion to it: turning takes the ground's friction, too
constexpr double MAX_YAW_RATE = 2.5;           // [rad/s]
constexpr double MAX_YAW_ACCELERATION = 15.0;  // [rad/s²]
constexpr double BRAKING = 0.7;                // share of it that a turn plans to brake with
// the heading follows the velocity's direction above the first speed and is held below the second:
// near rest that direction is noise
constexpr double HEADING_STARTS = 0.15, HEADING_STOPS = 0.10;  // [m/s]

struct BodyReference {      // what the trunk shall do in the plane
  double position[2];       // [m]
  double velocity[2];       // [m/s]
  double acceleration[2];   // [m/s²]
  double yaw;               // [rad]
  double yaw_rate;          // [rad/s]
  double yaw_acceleration;  // [rad/s²]
  bool turning;             // whether the heading follows the velocity at present
};

inline double sign(double x) { return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x; }

// Moves the reference on by one tick: p̈ = u, and the heading along the velocity.
//
// Exact for a constant u below the speed cap; the acceleration handed on is the one that remains after
// the cap, so that the trunk is never pushed against it. The reference does not run away from the
// robot. `grip` is the share of the fastest turn that the ground carries.
inline void advance(BodyReference& reference, const double* u, const double* robot_position, double dt,
                    double max_speed, bool follow_velocity, double grip) {
  double velocity[2], position[2], ahead[2];
  for (int i = 0; i < 2; ++i) velocity[i] = reference.velocity[i] + dt * u[i];
  double speed = std::sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1]);
  if (speed > max_speed) {
    const double share = max_speed / speed;
    for (double& v : velocity) v *= share;
    speed = max_speed;
  }
  for (int i = 0; i < 2; ++i) {
    position[i] = reference.position[i] + 0.5 * dt * (reference.velocity[i] + velocity[i]);
    ahead[i] = position[i] - robot_position[i];
  }
  const double distance = std::sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1]);
  if (distance > LEASH)
    for (int i = 0; i < 2; ++i) position[i] -= ahead[i] * (1.0 - LEASH / distance);
  for (int i = 0; i < 2; ++i) {
    reference.acceleration[i] = (velocity[i] - reference.velocity[i]) / dt;
    reference.velocity[i] = velocity[i];
    reference.position[i] = position[i];
  }

  const bool turning = follow_velocity && speed > (reference.turning ? HEADING_STOPS : HEADING_STARTS);
  const double error =
      turning ? rotation::wrap_angle(std::atan2(velocity[1], velocity[0]) - reference.yaw) : 0.0;
  // the fastest rate from which the turn can still be braked at the target
  const double most = grip * MAX_YAW_ACCELERATION;
  double rate = std::min(grip * MAX_YAW_RATE, std::sqrt(2.0 * BRAKING * most * std::abs(error)));
  rate = sign(error) * std::min(rate, std::abs(error) / dt);
  const double step = most * dt;
  const double yaw_rate = reference.yaw_rate + std::min(std::max(rate - reference.yaw_rate, -step), step);
  reference.turning = turning;
  reference.yaw_acceleration = (yaw_rate - reference.yaw_rate) / dt;
  reference.yaw_rate = yaw_rate;
  reference.yaw = rotation::wrap_angle(reference.yaw + dt * yaw_rate);
}

}  // namespace hcbf::body_reference
