// The trunk's planar velocity from the feet that stand.
#pragma once
#include <cmath>

#include <hcbf/leg.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/matrices.hpp>

namespace hcbf::leg_odometry {

using leg::FootKinematics;
using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;

struct FootVelocity {  // what a foot says of the trunk
  Vector2 velocity;    // of the trunk in the world, if the foot neither slips nor lifts [m/s]
  double gain;         // variance of that along an axis, over the variance of a joint's rate [m²]
};

// The trunk's velocity as a foot shows it. The foot is a ball that rolls: the point that rests on the
// ground lies the radius ρ below its centre and turns with the calf, so that
// v = −R(J q̇ + ω × r + (ω + ω_leg) × (−ρ Rᵀ e_z)).
inline FootVelocity trunk_velocity(const FootKinematics& feet, double radius, int leg,
                                   const RobotState& state, const Matrix3& R) {
  const double abad = state.joint_position[leg][0];
  const Vector3& rates = state.joint_velocity[leg];
  const double pitch = rates[1] + rates[2];
  Vector3 calf = state.angular_velocity;
  calf[0] += rates[0];
  calf[1] += std::cos(abad) * pitch;
  calf[2] += std::sin(abad) * pitch;
  const Matrix3& jacobian = feet.jacobian[leg];
  Vector3 moving = matrices::apply(jacobian, rates);
  matrices::add_cross(moving.at, state.angular_velocity.at, feet.position[leg].at);
  const Vector3 below = -radius * R[2];
  matrices::add_cross(moving.at, calf.at, below.at);
  double gain = 0.0;
  for (int axis = 0; axis < 2; ++axis)
    for (int joint = 0; joint < 3; ++joint) gain += 0.5 * (jacobian[axis][joint] * jacobian[axis][joint]);
  const Vector3 velocity = -matrices::apply(R, moving);
  return {{velocity[0], velocity[1]}, gain};
}

}  // namespace hcbf::leg_odometry
