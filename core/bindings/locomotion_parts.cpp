// The parts of a tick that Python calls one by one: environments and benchmarks some of them, tests all.
#include <hcbf/leg_odometry.hpp>
#include <hcbf/locomotion_tick.hpp>

#include "locomotion_structs.hpp"

namespace hcbf {

namespace {

using body_reference::BodyReference;
using dynamics::Bodies;
using feet::FootTargets;
using gait::Gait;
using leg::LegGeometry;
using locomotion_state::RobotState;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;
using rotation::rotation_matrix;

template <class T>
const T* rows_of(Matrix<const double> numbers) {
  return reinterpret_cast<const T*>(numbers.data);
}

auto foot_kinematics(const LegGeometry& legs, Vector<const double> joints, Vector<const double> velocity) {
  const auto feet = leg::foot_kinematics(legs, reinterpret_cast<const Vector3*>(joints.data),
                                         reinterpret_cast<const Vector3*>(velocity.data));
  return std::tuple(copied(feet.position[0].at, 4, 3), copied(feet.jacobian[0][0].at, 4, 3, 3),
                    copied(feet.bias[0].at, 4, 3));
}

auto trunk_velocity(const LegGeometry& legs, double radius, int leg, const RobotState& now) {
  const auto feet = leg::foot_kinematics(legs, now.joint_position, now.joint_velocity);
  const auto shown = leg_odometry::trunk_velocity(feet, radius, leg, now, rotation_matrix(now.quaternion));
  return std::pair(shown.velocity, shown.gain);
}

auto rigid_body_terms(const Bodies& bodies, const LegGeometry& legs, const Matrix3& R, Vector<const double> v,
                      Vector<const double> joints) {
  double M[18][18], bias[18];
  dynamics::rigid_body_terms(bodies, legs, R, v.data, reinterpret_cast<const Vector3*>(joints.data), M, bias);
  return std::pair(copied(M[0], 18, 18), copied(bias, 18));
}

void bind_kinematics(nb::module_& m) {
  m.def("rotation_matrix", &rotation_matrix, "quaternion"_a,
        "Return (3, 3) the rotation body → world of a unit quaternion (4,), w first.");
  m.def("rotation_vector_to_yaw", &rotation::rotation_vector_to_yaw, "R"_a, "yaw"_a,
        "Return (3,) log(Rᵀ R_z(yaw)): the turn, in body axes, that levels the body at yaw.");
  m.def("turned", &rotation::turned, "quaternion"_a, "rotation"_a,
        "Return (4,) an orientation turned by a small rotation (3,) about the world's axes [rad].");
  m.def("foot_kinematics", &foot_kinematics, "legs"_a, "joints"_a, "velocity"_a,
        "Return the feet's positions (4, 3), Jacobians (4, 3, 3) and J̇q̇ (4, 3) for joints and velocities (12,).");
  m.def("foot_bias", [](Vector<const double> v, const Vector3& r, const Matrix3& J, const Vector3& bias,
                        const Vector3& rate) { return leg::foot_bias(v.data, r, J, bias, rate); },
        "v"_a, "r"_a, "J"_a, "bias"_a, "joint_velocity"_a,
        "Return (3,) a foot's acceleration, in the trunk's axes, when all generalised ones are zero.");
  m.def("inverse_kinematics", &leg::inverse_kinematics, "legs"_a, "leg"_a, "foot"_a,
        "Return (3,) the joints that bring the foot to a place (3,) [rad].");
  m.def("trunk_velocity", &trunk_velocity, "legs"_a, "radius"_a, "leg"_a, "state"_a,
        "Return the trunk's planar velocity (2,) as a foot shows it, and its gain.");
  m.def("rigid_body_terms", &rigid_body_terms, "bodies"_a, "legs"_a, "R"_a, "v"_a, "joints"_a,
        "Return M (18, 18) and the bias (18,) of M q̈ + bias = Sᵀτ + JᵀF.");
}

auto foot_phases(const Gait& gait, double clock, Vector<const bool> contact) {
  const auto phases = gait::foot_phases(gait, clock, contact.data);
  const auto& [first, second, third, fourth] = phases.stance;
  return std::pair(std::tuple(first, second, third, fourth), copied(phases.remaining, 4));
}

auto nominal_stance(Matrix<const double> hip) {
  Vector2 nominal[4];
  for (int foot = 0; foot < 4; ++foot) nominal[foot] = feet::nominal_stance(rows_of<Vector3>(hip)[foot]);
  return copied(nominal[0].at, 4, 2);
}

void plan_feet(FootTargets& targets, const Gait& gait, double clock, Vector<const bool> contact,
               Matrix<const double> measured, Matrix<const double> nominal, double touchdown,
               const feet::Trunk& trunk, const BodyReference& reference, double dt) {
  feet::Places places;
  std::copy_n(rows_of<Vector3>(measured), 4, places.measured);
  std::copy_n(rows_of<Vector2>(nominal), 4, places.nominal);
  places.touchdown = touchdown;
  feet::plan_feet(targets, gait::foot_phases(gait, clock, contact.data), gait, places, trunk, reference, dt);
}

void bind_feet(nb::module_& m) {
  m.def("foot_phases", &foot_phases, "gait"_a, "clock"_a, "contact"_a,
        "Return which feet stand at a time of the clock [s], and the others' time until touchdown [s].");
  m.def("advance_clock", &gait::advance_clock, "gait"_a, "clock"_a, "quiet"_a, "dt"_a,
        "Return the gait's clock [s] one tick later.");
  m.def("minimum_jerk_step", [](double position, double velocity, double acceleration, double target,
                                double remaining, double dt) {
    const auto then = feet::minimum_jerk_step(position, velocity, acceleration, target, remaining, dt);
    return std::tuple(then.position, then.velocity, then.acceleration);
  }, "position"_a, "velocity"_a, "acceleration"_a, "target"_a, "remaining"_a, "dt"_a,
  "Return position, velocity and acceleration one tick later on the minimum-jerk path.");
  m.def("swing_step", &feet::swing_step, "now"_a, "foothold"_a, "touchdown"_a, "remaining"_a, "duration"_a,
        "dt"_a, "Return (3, 3) a swinging foot's position, velocity and acceleration one tick later.");
  m.def("nominal_stance", &nominal_stance, "hip"_a,
        "Return (4, 2) the footholds at rest in the trunk's axes, from the abad joints (4, 3) [m].");
  m.def("foothold", &feet::foothold, "nominal"_a, "trunk"_a, "reference"_a, "remaining"_a,
        "stance_time"_a, "Return (2,) the foothold in the world [m].");
  m.def("plan_feet", &plan_feet, "targets"_a, "gait"_a, "clock"_a, "contact"_a, "measured"_a, "nominal"_a,
        "touchdown"_a, "trunk"_a, "reference"_a, "dt"_a,
        "Move the feet's targets on by one tick of the gait's clock.");
  m.def("advance_reference", [](BodyReference& reference, Vector<const double> u,
                                Vector<const double> robot_position, double dt, double max_speed,
                                bool follow_velocity, double grip) {
    body_reference::advance(reference, u.data, robot_position.data, dt, max_speed, follow_velocity, grip);
  }, "reference"_a, "u"_a, "robot_position"_a, "dt"_a, "max_speed"_a, "follow_velocity"_a, "grip"_a,
  "Move the trunk's reference on by one tick under u (2,) [m/s²].");
}

void bind_program(nb::module_& m) {
  using tasks::TaskAccelerations;
  m.def("task_accelerations", [](const RobotState& state, const Matrix3& R, const leg::FootKinematics& feet,
                                 const BodyReference& reference, const FootTargets& targets, double too_low,
                                 double max_speed, TaskAccelerations& tasks) {
    tasks = tasks::task_accelerations(state, R, feet, reference, targets, too_low, max_speed);
  }, "state"_a, "R"_a, "feet"_a, "reference"_a, "targets"_a, "too_low"_a, "max_speed"_a, "tasks"_a,
  "Fill in the accelerations that the task-space QP shall come close to.");
  m.def("condense_task_space", [](const dynamics::Dynamics& robot, const TaskAccelerations& tasks,
                                  double friction, Matrix<const double> limits,
                                  task_space::Workspace& workspace) {
    return task_space::condense(robot, tasks, friction,
                                *reinterpret_cast<const double (*)[2][12]>(limits.data), workspace);
  }, "robot"_a, "tasks"_a, "friction"_a, "limits"_a, "workspace"_a,
  "Fill in the program in z (12,) and return how many feet stand.");
  m.def("free_minimiser", &task_space::free_minimiser, "workspace"_a, "rows"_a,
        "Set z = −H⁻¹f and return whether it meets every bound.");
  m.def("plan_tick", [](const locomotion_tick::Settings& settings, locomotion_tick::Memory& memory,
                        const RobotState& state, Vector<const double> u, locomotion_tick::TickPlan& plan) {
    locomotion_tick::plan(settings, memory, state, u.data, plan);
  }, "settings"_a, "memory"_a, "state"_a, "u"_a, "plan"_a,
  "Fill in what a tick decides before the QP, and move the memory on.");
}

}  // namespace

void bind_locomotion_parts(nb::module_& m) {
  bind_kinematics(m);
  bind_feet(m);
  bind_program(m);
  m.attr("RESTING") = gait::RESTING;
  m.attr("SWING_HEIGHT") = feet::SWING_HEIGHT;
  m.attr("MAX_OFFSET") = feet::MAX_OFFSET;
  m.attr("LEASH") = body_reference::LEASH;
  m.attr("MAX_YAW_RATE") = body_reference::MAX_YAW_RATE;
  m.attr("MAX_YAW_ACCELERATION") = body_reference::MAX_YAW_ACCELERATION;
  m.attr("PLANE_KP") = tasks::PLANE_KP;
  m.attr("PLANE_KD") = tasks::PLANE_KD;
  m.attr("CATCH_UP") = tasks::CATCH_UP;
  m.attr("HEIGHT_WEIGHT") = tasks::HEIGHT_WEIGHT;
  m.attr("FORCE_WEIGHT") = tasks::FORCE_WEIGHT;
  m.attr("FULL_GRIP") = locomotion_tick::FULL_GRIP;
}

}  // namespace hcbf
