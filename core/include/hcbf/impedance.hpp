// Joint impedance: feedback around the torques that the program feeds forward.
#pragma once
#include <hcbf/body_reference.hpp>
#include <hcbf/feet.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/matrices.hpp>

namespace hcbf::impedance {

using body_reference::BodyReference;
using feet::FootTargets;
using leg::FootKinematics;
using leg::LegGeometry;
using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector3;

constexpr double SWING_KP = 20.0, SWING_KD = 1.0;  // [N·m/rad], [N·m·s/rad]
constexpr double STANCE_KD = 1.0;                  // stance feet: damping only

// Fills in K_p(q_d − q) + K_d(q̇_d − q̇) of every leg's joints [N·m]. A swinging leg follows its foot's
// target through inverse kinematics; a standing leg moves as the trunk's desired velocity over a
// resting foot asks.
inline void joint_feedback(Vector3* torque, const RobotState& state, const Matrix3& R,
                           const LegGeometry& legs, const FootKinematics& feet, const FootTargets& targets,
                           const BodyReference& reference) {
  using matrices::apply, matrices::apply_transposed, matrices::cross;
  const Vector3 desired_velocity = {reference.velocity[0], reference.velocity[1], 0.0};
  const Vector3 desired_omega = reference.yaw_rate * R[2];
  for (int foot = 0; foot < 4; ++foot) {
    const Vector3& r = feet.position[foot];
    const Vector3& rate = state.joint_velocity[foot];
    const Matrix3 to_joints = matrices::inverse_3x3(feet.jacobian[foot]);
    if (targets.stance[foot]) {
      const Vector3 slide = -apply_transposed(R, desired_velocity) - cross(desired_omega, r);
      torque[foot] = STANCE_KD * (apply(to_joints, slide) - rate);
      continue;
    }
    const Vector3 &place = targets.motion[foot][0], &velocity = targets.motion[foot][1];
    const Vector3 joints = leg::inverse_kinematics(legs, foot, apply_transposed(R, place - state.position));
    const Vector3 slide =
        apply_transposed(R, velocity - state.linear_velocity) - cross(state.angular_velocity, r);
    torque[foot] =
        SWING_KP * (joints - state.joint_position[foot]) + SWING_KD * (apply(to_joints, slide) - rate);
  }
}

}  // namespace hcbf::impedance
