// What the controller is told about the robot: the estimate that sensors and an estimator would give.
//
// A state travels as one vector of 41 numbers, of which this is the view: MuJoCo's qpos (19,) and
// qvel (18,) of the robot, then the contacts. Joints and feet are ordered FR, FL, RR, RL; the joints
// of a leg abad, hip, knee.
#pragma once
#include <hcbf/matrices.hpp>
#include <hcbf/rotation.hpp>

namespace hcbf::locomotion_state {

using matrices::Vector3;
using rotation::Quaternion;

constexpr int STATE_SIZE = 41;

struct RobotState {
  Vector3 position;           // of the trunk's origin in the world [m]
  Quaternion quaternion;      // of the trunk
  Vector3 joint_position[4];  // of each leg [rad]
  Vector3 linear_velocity;    // of the trunk's origin, in the world's axes [m/s]
  Vector3 angular_velocity;   // of the trunk, in its own axes [rad/s]
  Vector3 joint_velocity[4];  // of each leg [rad/s]
  double contact[4];          // positive where the foot touches something

  bool touches(int foot) const { return contact[foot] > 0.0; }
};
static_assert(sizeof(RobotState) == STATE_SIZE * sizeof(double));

inline const RobotState& state_view(const double* vector) {
  return *reinterpret_cast<const RobotState*>(vector);
}
inline RobotState& state_view(double* vector) { return *reinterpret_cast<RobotState*>(vector); }

}  // namespace hcbf::locomotion_state
