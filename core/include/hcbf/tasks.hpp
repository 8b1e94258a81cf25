// The tasks y of the task-space controller: which accelerations would mend the errors.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/body_reference.hpp>
#include <hcbf/feet.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/matrices.hpp>
#include <hcbf/rotation.hpp>

namespace hcbf::tasks {

using body_reference::BodyReference;
using feet::FootTargets;
using leg::FootKinematics;
using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector3;

// Stiffness K_p [1/s²] and damping K_d [1/s]. The paper leaves them open; all are ours, about
// critically damped, K_d ≈ 2 √K_p, and held to the bounds of docs/locomotion.md.
constexpr double PLANE_KP = 80.0, PLANE_KD = 15.0;     // a third of the lag that 30 and 10 leave
constexpr double HEIGHT_KP = 150.0, HEIGHT_KD = 25.0;  // 12 rad/s: what remains is learnt, see HEIGHT_KI
constexpr double TILT_KP = 300.0, TILT_KD = 30.0;      // 17 rad/s, the fastest: a tilt moves every foot
constexpr double YAW_KP = 100.0, YAW_KD = 20.0;        // 10 rad/s: the reference turns at 2.5 rad/s at most
constexpr double SWING_KP = 400.0, SWING_KD = 40.0;    // 20 rad/s: a swing of 0.13 s shrinks an error by e^-2.6
// [m/s] above the speed cap at most, to make up for a lag: it halved the overspeed
constexpr double CATCH_UP = 0.1;

// the other tasks weigh 1: of what two feet cannot do at once, the height goes first
constexpr double HEIGHT_WEIGHT = 3.0;
constexpr double FORCE_WEIGHT = 1e-4;  // on ‖F‖², which decides between forces that do the same

struct TaskAccelerations {  // ÿ_d + K_d(ẏ_d − ẏ) + K_p(y_d − y) of every task
  Vector3 linear;           // of the trunk's origin, in the world's axes [m/s²]
  Vector3 angular;          // of the trunk, in its own axes [rad/s²]
  Vector3 feet[4];          // in the world's axes, read for swinging feet only [m/s²]
};

// The accelerations that the task-space QP shall come close to.
//
// In the plane the law reads ÿ_d + K_d(w − ẏ), and the speed w = ẏ_d + K_p/K_d (y_d − y) that would make
// up for a lag is bounded. `too_low` is the desired height of the trunk less the measured one [m],
// `max_speed` the cap on the reference's speed [m/s].
inline TaskAccelerations task_accelerations(const RobotState& state, const Matrix3& R,
                                            const FootKinematics& feet, const BodyReference& reference,
                                            const FootTargets& targets, double too_low, double max_speed) {
  using matrices::apply, matrices::cross;
  const Vector3 &position = state.position, &velocity = state.linear_velocity,
                &omega = state.angular_velocity;
  TaskAccelerations tasks = {};
  Vector3& linear = tasks.linear;
  for (int i = 0; i < 2; ++i) {
    const double lag = reference.position[i] - position[i];
    linear[i] = reference.velocity[i] + PLANE_KP / PLANE_KD * lag;
  }
  const double speed = std::sqrt(linear[0] * linear[0] + linear[1] * linear[1]);
  const double scale = std::min(1.0, (max_speed + CATCH_UP) / std::max(speed, 1e-9));
  for (int i = 0; i < 2; ++i)
    linear[i] = reference.acceleration[i] + PLANE_KD * (scale * linear[i] - velocity[i]);
  linear[2] = HEIGHT_KP * too_low - HEIGHT_KD * velocity[2];

  const Vector3 turn = rotation::rotation_vector_to_yaw(R, reference.yaw);
  const Vector3& up = R[2];  // the world's vertical in the trunk's axes
  for (int i = 0; i < 3; ++i) {
    const double kp = i == 2 ? YAW_KP : TILT_KP, kd = i == 2 ? YAW_KD : TILT_KD;
    tasks.angular[i] =
        reference.yaw_acceleration * up[i] + kd * (reference.yaw_rate * up[i] - omega[i]) + kp * turn[i];
  }

  for (int foot = 0; foot < 4; ++foot) {
    if (targets.stance[foot]) continue;
    const Vector3& r = feet.position[foot];
    const Vector3 own = apply(feet.jacobian[foot], state.joint_velocity[foot]);
    const Vector3 foot_position = position + apply(R, r);
    const Vector3 foot_velocity = velocity + apply(R, cross(omega, r) + own);
    const Matrix3& desired = targets.motion[foot];
    tasks.feet[foot] =
        desired[2] + SWING_KD * (desired[1] - foot_velocity) + SWING_KP * (desired[0] - foot_position);
  }
  return tasks;
}

}  // namespace hcbf::tasks
