// The parts of a tick that Python calls one by one: environments and benchmarks some of them, tests all.

#include <hcbf/leg_odometry.hpp>
#include <hcbf/locomotion_tick.hpp>

#include "records.hpp"

namespace hcbf {

namespace {

using body_reference::BodyReference;
using dynamics::Dynamics;
using feet::FootTargets;
using gait::Gait;
using leg::FootKinematics;
using leg::LegGeometry;
using locomotion_state::RobotState;
using locomotion_tick::Memory;
using locomotion_tick::Settings;
using locomotion_tick::TickPlan;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;
using task_space::Workspace;
using tasks::TaskAccelerations;
using Mask = Numbers<const bool, 1>;

auto of_feet(const FootKinematics& feet) {
  return nb::make_tuple(copied(feet.position[0].at, 4, 3), copied(feet.jacobian[0][0].at, 4, 3, 3),
                        copied(feet.bias[0].at, 4, 3));
}

void bind_kinematics(nb::module_& m) {
  m.def(
      "rotation_matrix",
      [](const Given1& quaternion) {
        return copied(rotation::rotation_matrix(as<rotation::Quaternion>(quaternion))[0].at, 3, 3);
      },
      nb::arg("quaternion"), "Return (3, 3) the rotation body → world of a unit quaternion (4,), w first.");
  m.def(
      "rotation_vector_to_yaw",
      [](const Given2& R, double yaw) {
        return copied(rotation::rotation_vector_to_yaw(as<Matrix3>(R), yaw).at, 3);
      },
      nb::arg("R"), nb::arg("yaw"),
      "Return (3,) log(Rᵀ R_z(yaw)): the turn, in body axes, that levels the body at yaw.");
  m.def(
      "turned",
      [](const Given1& quaternion, const Given1& by) {
        const auto turned = rotation::turned(as<rotation::Quaternion>(quaternion), as<Vector3>(by));
        return copied(&turned.w, 4);
      },
      nb::arg("quaternion"), nb::arg("rotation"),
      "Return (4,) an orientation turned by a small rotation (3,) about the world's axes [rad].");
  m.def(
      "foot_kinematics",
      [](const Word& legs, const Given1& joints, const Given1& velocity) {
        return of_feet(
            leg::foot_kinematics(record<LegGeometry>(legs), &as<Vector3>(joints), &as<Vector3>(velocity)));
      },
      nb::arg("legs"), nb::arg("joints"), nb::arg("velocity"),
      "Return the feet's positions (4, 3), Jacobians (4, 3, 3) and J̇q̇ (4, 3) for joints and velocities "
      "(12,).");
  m.def(
      "foot_bias",
      [](const Given1& v, const Given1& r, const Given2& J, const Given1& bias,
         const Given1& joint_velocity) {
        return copied(leg::foot_bias(v.data(), as<Vector3>(r), as<Matrix3>(J), as<Vector3>(bias),
                                     as<Vector3>(joint_velocity))
                          .at,
                      3);
      },
      nb::arg("v"), nb::arg("r"), nb::arg("J"), nb::arg("bias"), nb::arg("joint_velocity"),
      "Return (3,) a foot's acceleration, in the trunk's axes, when all generalised ones are zero.");
  m.def(
      "inverse_kinematics",
      [](const Word& legs, int leg, const Given1& foot) {
        return copied(leg::inverse_kinematics(record<LegGeometry>(legs), leg, as<Vector3>(foot)).at, 3);
      },
      nb::arg("legs"), nb::arg("leg"), nb::arg("foot"),
      "Return (3,) the joints that bring the foot to a place (3,) [rad].");
  m.def(
      "trunk_velocity",
      [](const Word& legs, double radius, int leg, const Given1& state) {
        const auto& now = as<RobotState>(state);
        const auto feet =
            leg::foot_kinematics(record<LegGeometry>(legs), now.joint_position, now.joint_velocity);
        const auto R = rotation::rotation_matrix(now.quaternion);
        const auto shown = leg_odometry::trunk_velocity(feet, radius, leg, now, R);
        return nb::make_tuple(copied(shown.velocity.at, 2), shown.gain);
      },
      nb::arg("legs"), nb::arg("radius"), nb::arg("leg"), nb::arg("state"),
      "Return the trunk's planar velocity (2,) as a foot shows it, and its gain.");
  m.def(
      "rigid_body_terms",
      [](const Word& bodies, const Word& legs, const Given2& R, const Given1& v, const Given1& joints) {
        double M[18][18], bias[18];
        dynamics::rigid_body_terms(record<dynamics::Bodies>(bodies), record<LegGeometry>(legs),
                                   as<Matrix3>(R), v.data(), &as<Vector3>(joints), M, bias);
        return nb::make_tuple(copied(M[0], 18, 18), copied(bias, 18));
      },
      nb::arg("bodies"), nb::arg("legs"), nb::arg("R"), nb::arg("v"), nb::arg("joints"),
      "Return M (18, 18) and the bias (18,) of M q̈ + bias = Sᵀτ + JᵀF.");
}

void bind_feet(nb::module_& m) {
  m.def(
      "foot_phases",
      [](const Word& gait, double clock, const Mask& contact) {
        const auto phases = gait::foot_phases(record<Gait>(gait), clock, contact.data());
        nb::list stance;
        for (bool stands : phases.stance) stance.append(stands);
        return nb::make_tuple(stance, copied(phases.remaining, 4));
      },
      nb::arg("gait"), nb::arg("clock"), nb::arg("contact"),
      "Return which feet stand at a time of the clock [s], and the others' time until touchdown [s].");
  m.def(
      "advance_clock",
      [](const Word& gait, double clock, bool quiet, double dt) {
        return gait::advance_clock(record<Gait>(gait), clock, quiet, dt);
      },
      nb::arg("gait"), nb::arg("clock"), nb::arg("quiet"), nb::arg("dt"),
      "Return the gait's clock [s] one tick later.");
  m.def(
      "minimum_jerk_step",
      [](double position, double velocity, double acceleration, double target, double remaining, double dt) {
        const auto then = swing::minimum_jerk_step(position, velocity, acceleration, target, remaining, dt);
        return std::tuple(then.position, then.velocity, then.acceleration);
      },
      nb::arg("position"), nb::arg("velocity"), nb::arg("acceleration"), nb::arg("target"),
      nb::arg("remaining"), nb::arg("dt"),
      "Return position, velocity and acceleration one tick later on the minimum-jerk way.");
  m.def(
      "swing_step",
      [](const Given2& now, const Given1& foothold, double touchdown, double remaining, double duration,
         double dt) {
        return copied(
            swing::swing_step(as<Matrix3>(now), as<Vector2>(foothold), touchdown, remaining, duration, dt)[0]
                .at,
            3, 3);
      },
      nb::arg("now"), nb::arg("foothold"), nb::arg("touchdown"), nb::arg("remaining"), nb::arg("duration"),
      nb::arg("dt"), "Return (3, 3) a swinging foot's position, velocity and acceleration one tick later.");
  m.def(
      "nominal_stance",
      [](const Given2& hip) {
        Vector2 nominal[4];
        for (int foot = 0; foot < 4; ++foot)
          nominal[foot] = foothold::nominal_stance((&as<Vector3>(hip))[foot]);
        return copied(nominal[0].at, 4, 2);
      },
      nb::arg("hip"),
      "Return (4, 2) the footholds at rest in the trunk's axes, from the abad joints (4, 3) [m].");
  m.def(
      "foothold",
      [](const Given1& nominal, const Given1& position, const Given1& velocity, double yaw, double height,
         const Word& reference, double remaining, double stance_time) {
        const foothold::Trunk trunk = {as<Vector3>(position), as<Vector3>(velocity), yaw, height};
        return copied(foothold::foothold(as<Vector2>(nominal), trunk, record<BodyReference>(reference),
                                         remaining, stance_time)
                          .at,
                      2);
      },
      nb::arg("nominal"), nb::arg("position"), nb::arg("velocity"), nb::arg("yaw"), nb::arg("height"),
      nb::arg("reference"), nb::arg("remaining"), nb::arg("stance_time"),
      "Return (2,) the foothold in the world [m].");
  m.def(
      "plan_feet",
      [](const Word& targets, const Word& gait, double clock, const Mask& contact, const Given2& measured,
         const Given2& nominal, double touchdown, const Given1& position, const Given1& velocity, double yaw,
         double height, const Word& reference, double dt) {
        feet::Places places;
        std::copy_n(&as<Vector3>(measured), 4, places.measured);
        std::copy_n(&as<Vector2>(nominal), 4, places.nominal);
        places.touchdown = touchdown;
        const auto phases = gait::foot_phases(record<Gait>(gait), clock, contact.data());
        feet::plan_feet(record<FootTargets>(targets), phases, record<Gait>(gait), places,
                        {as<Vector3>(position), as<Vector3>(velocity), yaw, height},
                        record<BodyReference>(reference), dt);
      },
      nb::arg("targets").noconvert(), nb::arg("gait"), nb::arg("clock"), nb::arg("contact"),
      nb::arg("measured"), nb::arg("nominal"), nb::arg("touchdown"), nb::arg("position"), nb::arg("velocity"),
      nb::arg("yaw"), nb::arg("height"), nb::arg("reference"), nb::arg("dt"),
      "Move the feet's targets on by one tick of the gait's clock.");
  m.def(
      "advance_reference",
      [](const Word& reference, const Given1& u, const Given1& robot_position, double dt, double max_speed,
         bool follow_velocity, double grip) {
        body_reference::advance(record<BodyReference>(reference), u.data(), robot_position.data(), dt,
                                max_speed, follow_velocity, grip);
      },
      nb::arg("reference").noconvert(), nb::arg("u"), nb::arg("robot_position"), nb::arg("dt"),
      nb::arg("max_speed"), nb::arg("follow_velocity"), nb::arg("grip"),
      "Move the trunk's reference on by one tick under u (2,) [m/s²].");
}

void bind_program(nb::module_& m) {
  m.def(
      "task_accelerations",
      [](const Given1& state, const Given2& R, const Word& feet, const Word& reference,
         const Word& targets, double too_low, double max_speed, const Word& tasks) {
        record<TaskAccelerations>(tasks) = tasks::task_accelerations(
            as<RobotState>(state), as<Matrix3>(R), record<FootKinematics>(feet),
            record<BodyReference>(reference), record<FootTargets>(targets), too_low, max_speed);
      },
      nb::arg("state"), nb::arg("R"), nb::arg("feet"), nb::arg("reference"), nb::arg("targets"),
      nb::arg("too_low"), nb::arg("max_speed"), nb::arg("tasks").noconvert(),
      "Fill in the accelerations that the task-space QP shall come close to.");
  m.def(
      "condense_task_space",
      [](const Word& robot, const Word& tasks, double friction, const Given2& limits,
         const Word& workspace) {
        return task_space::condense(record<Dynamics>(robot), record<TaskAccelerations>(tasks), friction,
                                    *reinterpret_cast<const double (*)[2][12]>(limits.data()),
                                    record<Workspace>(workspace));
      },
      nb::arg("robot"), nb::arg("tasks"), nb::arg("friction"), nb::arg("limits"),
      nb::arg("workspace").noconvert(), "Fill in the program in z (12,) and return how many feet stand.");
  m.def(
      "free_minimiser",
      [](const Word& workspace, int rows) {
        return task_space::free_minimiser(record<Workspace>(workspace), rows);
      },
      nb::arg("workspace").noconvert(), nb::arg("rows"),
      "Set z = −H⁻¹f and return whether it meets every bound.");
  m.def(
      "plan_tick",
      [](const Word& settings, const Word& memory, const Given1& state, const Given1& u,
         const Word& plan) {
        locomotion_tick::plan(record<Settings>(settings), record<Memory>(memory), as<RobotState>(state),
                              u.data(), record<TickPlan>(plan));
      },
      nb::arg("settings"), nb::arg("memory").noconvert(), nb::arg("state"), nb::arg("u"),
      nb::arg("plan").noconvert(), "Fill in what a tick decides before the QP, and move the memory on.");
}

}  // namespace

void bind_locomotion_parts(nb::module_& m) {
  bind_kinematics(m);
  bind_feet(m);
  bind_program(m);
  m.attr("RESTING") = gait::RESTING;
  m.attr("SWING_HEIGHT") = swing::SWING_HEIGHT;
  m.attr("MAX_OFFSET") = foothold::MAX_OFFSET;
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
