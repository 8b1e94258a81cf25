// One tick of the controller, from the state to the QP: the compiled half of the paper's Fig. 2.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/body_reference.hpp>
#include <hcbf/dynamics.hpp>
#include <hcbf/feet.hpp>
#include <hcbf/gait.hpp>
#include <hcbf/impedance.hpp>
#include <hcbf/leg.hpp>
#include <hcbf/locomotion_state.hpp>
#include <hcbf/matrices.hpp>
#include <hcbf/rotation.hpp>
#include <hcbf/task_space.hpp>
#include <hcbf/tasks.hpp>

namespace hcbf::locomotion_tick {

using body_reference::BodyReference;
using dynamics::Bodies;
using dynamics::Dynamics;
using feet::FootTargets;
using gait::Gait;
using leg::LegGeometry;
using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;
using task_space::Workspace;
using tasks::TaskAccelerations;

constexpr double GROUND_GAIN = 0.02;  // per tick, by which the ground's estimate follows the standing feet
constexpr double FULL_GRIP = 0.6;     // µ on which the robot turns as fast as it can
// what the model leaves out (impacts, latency) grows with the speed and would lift the trunk
constexpr double HEIGHT_KI = 300.0, MAX_LIFT = 8.0;  // [1/s³], [m/s²]

// a gait that rests may rest while all of these stay below
constexpr double QUIET_INPUT = 0.02;     // [m/s²] asked of the robot, and [m/s] of its reference
constexpr double QUIET_VELOCITY = 0.08;  // [m/s] in any direction
constexpr double QUIET_ROTATION = 0.4;   // [rad/s] about any axis
constexpr double QUIET_DISTANCE = 0.02;  // [m] from the reference

struct Settings {
  double timestep;           // [s]
  double friction;           // µ of the friction pyramid
  double stall_torque[12];   // of the joints at rest [N·m]
  double no_load_speed[12];  // of the joints [rad/s]
  double height;             // of the trunk above the ground [m]
  double max_speed;          // cap on the reference's speed [m/s]
  bool follow_velocity;      // whether the heading does
  double foot_radius;        // [m]
  Gait gait;
  LegGeometry legs;
  Vector2 nominal[4];  // footholds at rest in the trunk's axes [m]
  Bodies bodies;
};

struct Memory {
  BodyReference reference;
  FootTargets targets;
  double clock;   // of the gait [s]
  double ground;  // estimated height of the ground [m]
  double lift;    // learnt acceleration upwards that holds the trunk's height [m/s²]
};

struct TickPlan {           // what a tick has decided when it comes to the QP
  Dynamics robot;           // at this instant
  TaskAccelerations tasks;  // the accelerations to come close to
  Vector3 feedback[4];      // torques of the joint impedance [N·m]
};

// The largest magnitude, NaN where there is one.
inline double largest(const double* values, int count) {
  double most = 0.0;
  for (int i = 0; i < count; ++i) {
    if (std::isnan(values[i])) return values[i];
    most = std::max(most, std::abs(values[i]));
  }
  return most;
}

// Whether nothing is asked and nothing disturbs; at rest twice as much is tolerated.
inline bool is_quiet(const RobotState& state, const BodyReference& reference, const double* u, bool resting) {
  const double scale = resting ? 2.0 : 1.0;
  const double asked =
      std::max(std::max(largest(u, 2), largest(reference.velocity, 2)), std::abs(reference.yaw_rate));
  const double away[2] = {state.position[0] - reference.position[0],
                          state.position[1] - reference.position[1]};
  return asked < scale * QUIET_INPUT && largest(away, 2) < scale * QUIET_DISTANCE &&
         largest(state.linear_velocity.at, 3) < scale * QUIET_VELOCITY &&
         largest(state.angular_velocity.at, 3) < scale * QUIET_ROTATION;
}

// The ground's height [m], drawn slowly towards the feet that carry.
inline double ground_height(double ground, const Vector3* feet, const bool* carrying, double radius) {
  double total = 0.0;
  int count = 0;
  for (int foot = 0; foot < 4; ++foot) {
    if (!carrying[foot]) continue;
    total += feet[foot][2] - radius;
    ++count;
  }
  return count ? ground + GROUND_GAIN * (total / count - ground) : ground;
}

// What comes before the QP: gait → footholds → swing → tasks, and the impedance. The memory moves on by
// one tick; u is the desired acceleration of the trunk in the world [m/s²].
inline void plan(const Settings& settings, Memory& memory, const RobotState& state, const double* u,
                 TickPlan& out) {
  const double dt = settings.timestep;
  BodyReference& reference = memory.reference;
  FootTargets& targets = memory.targets;
  Dynamics& robot = out.robot;
  robot.R = rotation::rotation_matrix(state.quaternion);
  const Matrix3& R = robot.R;
  const Vector3 forwards = matrices::apply_transposed(R, state.linear_velocity);
  std::copy(forwards.at, forwards.at + 3, robot.v);
  std::copy(state.angular_velocity.at, state.angular_velocity.at + 3, robot.v + 3);
  for (int joint = 0; joint < 12; ++joint) robot.v[6 + joint] = state.joint_velocity[joint / 3][joint % 3];
  dynamics::rigid_body_terms(settings.bodies, settings.legs, R, robot.v, state.joint_position, robot.M,
                             robot.bias);
  robot.feet = leg::foot_kinematics(settings.legs, state.joint_position, state.joint_velocity);
  feet::Places places;
  bool contact[4], carrying[4];
  for (int foot = 0; foot < 4; ++foot) {
    places.measured[foot] = state.position + matrices::apply(R, robot.feet.position[foot]);
    places.nominal[foot] = settings.nominal[foot];
    contact[foot] = state.touches(foot);
  }

  const double grip = std::min(1.0, settings.friction / FULL_GRIP);
  body_reference::advance(reference, u, state.position.at, dt, settings.max_speed, settings.follow_velocity,
                          grip);
  const gait::FootPhases phases = gait::foot_phases(settings.gait, memory.clock, contact);
  for (int foot = 0; foot < 4; ++foot) carrying[foot] = phases.stance[foot] && contact[foot];
  memory.ground = ground_height(memory.ground, places.measured, carrying, settings.foot_radius);
  places.touchdown = memory.ground + settings.foot_radius;
  const feet::Trunk trunk = {state.position, state.linear_velocity, rotation::yaw_of(R), settings.height};
  feet::plan_feet(targets, phases, settings.gait, places, trunk, reference, dt);
  const double too_low = memory.ground + settings.height - state.position[2];
  memory.lift += dt * HEIGHT_KI * too_low;
  memory.lift = std::min(std::max(memory.lift, -MAX_LIFT), MAX_LIFT);
  out.tasks =
      tasks::task_accelerations(state, R, robot.feet, reference, targets, too_low, settings.max_speed);
  out.tasks.linear[2] += memory.lift;
  impedance::joint_feedback(out.feedback, state, R, settings.legs, robot.feet, targets, reference);
  const bool quiet = is_quiet(state, reference, u, memory.clock < 0.0);
  memory.clock = gait::advance_clock(settings.gait, memory.clock, quiet, dt);
  std::copy(targets.stance, targets.stance + 4, robot.stance);
}

struct Program {  // of a tick
  int contacts;   // feet that stand
  bool free;      // whether no bound binds: then the QP is solved and the torques are set
};

// Runs a tick up to the QP.
inline Program tick(const Settings& settings, Memory& memory, Workspace& work, const RobotState& state,
                    const double* u) {
  impedance::torque_limits({settings.stall_torque, 12}, {settings.no_load_speed, 12},
                        {state.joint_velocity[0].at, 12}, {work.limits[0], 2, 12});
  TickPlan planned;
  plan(settings, memory, state, u, planned);
  const int contacts =
      task_space::condense(planned.robot, planned.tasks, settings.friction, work.limits, work);
  std::copy(planned.feedback, planned.feedback + 4, work.feedback);
  const bool free = task_space::free_minimiser(work, 12 + 4 * contacts);
  if (free) task_space::take_solution(work);
  return {contacts, free};
}

}  // namespace hcbf::locomotion_tick
