// Joint impedance: feedback around the torques that the program feeds forward; and what motors give.
#pragma once
#include <algorithm>

#include <hcbf/arrays.hpp>
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

// Fills in the least and the largest torque (2, 12) that the motors give at `rate` [N·m]:
// τ_max = clip(τ_s (1 − q̇/ω₀), 0, τ_s) and τ_min = −clip(τ_s (1 + q̇/ω₀), 0, τ_s). A motor pulls fully
// at rest and while it brakes, and not at all beyond its no-load speed.
//
// Source: the DC motor of Isaac Lab, whose A1 has 33.5 N·m and 21 rad/s as in Unitree's a1.urdf
// (isaaclab.actuators.DCMotor, isaaclab_assets.robots.unitree.UNITREE_A1_CFG).
inline void torque_limits(Vector<const double> stall, Vector<const double> no_load_speed,
                          Vector<const double> rate, Matrix<double> limits) {
  for (Index joint = 0; joint < 12; ++joint) {
    const double share = rate[joint] / no_load_speed[joint];
    limits(0, joint) = -stall[joint] * std::min(std::max(1.0 + share, 0.0), 1.0);
    limits(1, joint) = stall[joint] * std::min(std::max(1.0 - share, 0.0), 1.0);
  }
}

// Fills in what the motors deliver (12,) of `strength` times the commanded torque (12,) [N·m].
inline void drive(Vector<const double> stall, Vector<const double> no_load_speed, Vector<const double> rate,
                  double strength, Vector<const double> command, Vector<double> delivered) {
  double limits[2][12];
  torque_limits(stall, no_load_speed, rate, {limits[0], 2, 12});
  for (Index joint = 0; joint < 12; ++joint) {
    const double torque = strength * command[joint];
    delivered[joint] = std::min(std::max(torque, limits[0][joint]), limits[1][joint]);
  }
}

}  // namespace hcbf::impedance
