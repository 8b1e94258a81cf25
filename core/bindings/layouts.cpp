// The records that Python shares, as NumPy describes them; `arrays.record_type` makes dtypes of them.
#include <hcbf/estimation_tick.hpp>
#include <hcbf/field.hpp>
#include <hcbf/local_guidance.hpp>
#include <hcbf/locomotion_tick.hpp>
#include <hcbf/motion_monitor.hpp>
#include <hcbf/plants.hpp>

#include <cstddef>
#include <type_traits>
#include <utility>
#include <vector>

#include "bindings.hpp"

namespace hcbf {

namespace {

struct Field {
  const char* name;
  nb::object type;
  std::size_t offset;
};
using Fields = std::vector<Field>;

// The dtype of a struct by its fields, as NumPy takes it.
nb::object described(std::size_t size, const Fields& fields) {
  nb::list names, formats, offsets;
  for (const Field& field : fields)
    names.append(field.name), formats.append(field.type), offsets.append(field.offset);
  nb::dict dtype;
  dtype["names"] = names, dtype["formats"] = formats, dtype["offsets"] = offsets, dtype["itemsize"] = size;
  return dtype;
}

// The fields of a record; other structs are the numbers that they are made of.
template <class T>
Fields fields_of() {
  return {};
}

template <class T>
nb::object type_of() {
  if constexpr (std::is_array_v<T>) {
    return nb::make_tuple(type_of<std::remove_extent_t<T>>(), std::extent_v<T>);
  } else if constexpr (std::is_same_v<T, bool>) {
    return nb::str("?");
  } else if constexpr (std::is_same_v<T, double>) {
    return nb::str("f8");
  } else if constexpr (std::is_same_v<T, matrices::Matrix3>) {
    return type_of<double[3][3]>();
  } else if constexpr (std::is_class_v<T>) {
    const Fields fields = fields_of<T>();
    return fields.empty() ? type_of<double[sizeof(T) / sizeof(double)]>() : described(sizeof(T), fields);
  } else {
    static_assert(sizeof(T) == sizeof(Index));  // a whole number, or a code
    return nb::str("i8");
  }
}

#define FIELD(field) \
  Field { #field, type_of<decltype(Record::field)>(), offsetof(Record, field) }
#define RECORD(T, ...)       \
  template <>                \
  Fields fields_of<T>() {    \
    using Record = T;        \
    return {__VA_ARGS__};    \
  }

// Puts the fields of a record that lies within another one at the place of its own.
void put_within(Fields& fields, std::size_t place, const Fields& parts) {
  for (const Field& part : parts) fields.push_back({part.name, part.type, part.offset + place});
}

RECORD(gait::Gait, FIELD(period), FIELD(duty), FIELD(offsets), FIELD(rests), FIELD(max_speed))
RECORD(leg::LegGeometry, FIELD(hip), FIELD(offset), FIELD(thigh), FIELD(calf))
RECORD(leg::FootKinematics, FIELD(position), FIELD(jacobian), FIELD(bias))
RECORD(dynamics::Bodies, FIELD(mass), FIELD(com), FIELD(inertia), FIELD(armature), FIELD(damping),
       FIELD(dry_friction))
RECORD(dynamics::Dynamics, FIELD(M), FIELD(bias), FIELD(v), FIELD(R), FIELD(feet), FIELD(stance))
RECORD(body_reference::BodyReference, FIELD(position), FIELD(velocity), FIELD(acceleration), FIELD(yaw),
       FIELD(yaw_rate), FIELD(yaw_acceleration), FIELD(turning))
RECORD(feet::FootTargets, FIELD(stance), FIELD(motion), FIELD(foothold))
RECORD(locomotion_tick::Settings, FIELD(timestep), FIELD(friction), FIELD(stall_torque),
       FIELD(no_load_speed), FIELD(height), FIELD(max_speed), FIELD(follow_velocity), FIELD(foot_radius),
       FIELD(gait), FIELD(legs), FIELD(nominal), FIELD(bodies))
RECORD(locomotion_tick::Memory, FIELD(reference), FIELD(targets), FIELD(clock), FIELD(ground), FIELD(lift))
RECORD(task_space::Workspace, FIELD(H), FIELD(f), FIELD(A), FIELD(lower), FIELD(upper),
       FIELD(torque_offset), FIELD(z), FIELD(feedforward), FIELD(feedback), FIELD(limits), FIELD(torque))
RECORD(tasks::TaskAccelerations, FIELD(linear), FIELD(angular), FIELD(feet))
RECORD(locomotion_tick::TickPlan, FIELD(robot), FIELD(tasks), FIELD(feedback))
RECORD(locomotion_state::RobotState, FIELD(position), FIELD(quaternion), FIELD(joint_position),
       FIELD(linear_velocity), FIELD(angular_velocity), FIELD(joint_velocity), FIELD(contact))
RECORD(kalman::Model, FIELD(timestep), FIELD(keep), FIELD(variance), FIELD(fix))
RECORD(sensing::Errors, FIELD(timestep), FIELD(fix), FIELD(drift), FIELD(keep_drift), FIELD(rotation),
       FIELD(keep_rotation), FIELD(slip), FIELD(keep_slip), FIELD(gyroscope), FIELD(accelerometer),
       FIELD(angle), FIELD(rate), FIELD(contact))
RECORD(estimation_tick::Settings, FIELD(model), FIELD(errors), FIELD(legs), FIELD(foot_radius),
       FIELD(settled), FIELD(period), FIELD(delay), FIELD(start))
RECORD(monitor::Inputs, FIELD(error), FIELD(missed), FIELD(exact), FIELD(off), FIELD(samples))
RECORD(monitor::Motion, FIELD(drift), FIELD(motion), FIELD(body), FIELD(bend), FIELD(in_a_row))
RECORD(conclusion::Memory, FIELD(change), FIELD(kept), FIELD(headway), FIELD(unproved), FIELD(closing))
RECORD(gatekeeper::Law, FIELD(target), FIELD(samples), FIELD(own), FIELD(begun))
RECORD(gatekeeper::Reserve, FIELD(keep), FIELD(ahead), FIELD(drift), FIELD(speed), FIELD(faster))
RECORD(gatekeeper::Memory, FIELD(law), FIELD(reserve), FIELD(rank), FIELD(sure), FIELD(lost))
RECORD(Uncertainty, FIELD(distance), FIELD(per_velocity), FIELD(per_lead), FIELD(cap), FIELD(confidence),
       FIELD(body), FIELD(speed), FIELD(speed_per_velocity))
template <>
Fields fields_of<plants::Constants>() {
  using Record = plants::Constants;
  Fields fields = {FIELD(lower), FIELD(by_level), FIELD(lock), FIELD(ranks), FIELD(guided), FIELD(radius),
                   FIELD(lambda_u), FIELD(known_offset), FIELD(corners), FIELD(weights),
                   FIELD(made), FIELD(rows), FIELD(period), FIELD(rounding), FIELD(dip), FIELD(tracking),
                   FIELD(settles), FIELD(drives), FIELD(axle), FIELD(axle_rows), FIELD(jerk),
                   FIELD(has_way), FIELD(through), FIELD(brakes), FIELD(observed), FIELD(gates),
                   FIELD(directions), FIELD(laws), FIELD(position_error), FIELD(velocity_error),
                   FIELD(longest)};
  put_within(fields, offsetof(Record, uncertainty), fields_of<Uncertainty>());
  return fields;
}

template <>
Fields fields_of<plants::Plant>() {
  using Record = plants::Plant;
  Fields fields = {FIELD(x), FIELD(time), FIELD(model), FIELD(lag), FIELD(covariance), FIELD(elapsed),
                   FIELD(fault), FIELD(has_model), FIELD(heading), FIELD(way), FIELD(turns), FIELD(turn),
                   FIELD(reachable), FIELD(lost), FIELD(zone), FIELD(expected), FIELD(vague), FIELD(growth),
                   FIELD(accepted), FIELD(headed), FIELD(accepted_at), FIELD(follows), FIELD(known),
                   FIELD(alarm), FIELD(moves), FIELD(verified)};
  put_within(fields, offsetof(Record, inputs), fields_of<monitor::Inputs>());
  put_within(fields, offsetof(Record, motion), fields_of<monitor::Motion>());
  put_within(fields, offsetof(Record, judged), fields_of<conclusion::Memory>());
  return fields;
}

RECORD(report::Plant, FIELD(intervention), FIELD(fallbacks), FIELD(model_error), FIELD(reachable),
       FIELD(deadlock), FIELD(alpha1_scale), FIELD(status), FIELD(reason), FIELD(covered),
       FIELD(covered_by), FIELD(proved), FIELD(verified))
RECORD(report::Row, FIELD(slack), FIELD(delta), FIELD(margin), FIELD(h), FIELD(psi), FIELD(conditioning))
RECORD(command_history::Commands, FIELD(since), FIELD(leads), FIELD(ends), FIELD(count), FIELD(acting),
       FIELD(velocity), FIELD(braked))
RECORD(command_history::Response, FIELD(tau), FIELD(delay), FIELD(braking), FIELD(overshoot))
RECORD(motion_monitor::Position, FIELD(missing), FIELD(residual), FIELD(variance), FIELD(average),
       FIELD(deviation))
RECORD(motion_monitor::Sums, FIELD(strayed), FIELD(moved), FIELD(doubt), FIELD(apart), FIELD(widest),
       FIELD(seen), FIELD(correlated), FIELD(power), FIELD(hidden))
template <>
Fields fields_of<motion_monitor::Notes>() {
  using Record = motion_monitor::Notes;
  Fields fields = {FIELD(place), FIELD(time), FIELD(begun), FIELD(worst)};
  put_within(fields, offsetof(Record, commands), fields_of<command_history::Commands>());
  put_within(fields, offsetof(Record, twist), fields_of<monitor::Motion>());
  put_within(fields, offsetof(Record, position), fields_of<motion_monitor::Position>());
  put_within(fields, offsetof(Record, sums), fields_of<motion_monitor::Sums>());
  return fields;
}

template <>
Fields fields_of<motion_monitor::Law>() {
  using Record = motion_monitor::Law;
  Fields fields = {FIELD(first), FIELD(most), FIELD(lasting), FIELD(share), FIELD(arc), FIELD(forward),
                   FIELD(regular), FIELD(hardest)};
  put_within(fields, offsetof(Record, response), fields_of<command_history::Response>());
  return fields;
}

RECORD(axle::Axle, FIELD(look_ahead), FIELD(forward), FIELD(turn), FIELD(braking))
RECORD(class_k::ClassK, FIELD(kind), FIELD(scale), FIELD(rate), FIELD(offset))
RECORD(field::Geometry, FIELD(x), FIELD(y), FIELD(side), FIELD(ny), FIELD(nx), FIELD(cos), FIELD(sin))
RECORD(local_guidance::Memory, FIELD(side), FIELD(since))
template <class T>
void put(nb::dict& all, const char* name) {
  all[name] = described(sizeof(T), fields_of<T>());
}

}  // namespace

void bind_layouts(nb::module_& m) {
  nb::dict all;
  put<plants::Constants>(all, "plants.Constants");
  put<plants::Plant>(all, "plants.Plant");
  put<report::Plant>(all, "report.Plant");
  put<report::Row>(all, "report.Row");
  put<gait::Gait>(all, "Gait");
  put<leg::LegGeometry>(all, "LegGeometry");
  put<dynamics::Bodies>(all, "Bodies");
  put<dynamics::Dynamics>(all, "Dynamics");
  put<body_reference::BodyReference>(all, "BodyReference");
  put<feet::FootTargets>(all, "FootTargets");
  put<locomotion_tick::Settings>(all, "locomotion_tick.Settings");
  put<locomotion_tick::Memory>(all, "locomotion_tick.Memory");
  put<task_space::Workspace>(all, "Workspace");
  put<tasks::TaskAccelerations>(all, "TaskAccelerations");
  put<locomotion_tick::TickPlan>(all, "TickPlan");
  put<locomotion_state::RobotState>(all, "RobotState");
  put<kalman::Model>(all, "kalman.Model");
  put<estimation_tick::Settings>(all, "estimation_tick.Settings");
  put<motion_monitor::Notes>(all, "motion_monitor.Notes");
  put<motion_monitor::Law>(all, "motion_monitor.Law");
  put<axle::Axle>(all, "Axle");
  put<class_k::ClassK>(all, "ClassK");
  put<field::Geometry>(all, "Geometry");
  put<local_guidance::Memory>(all, "local_guidance.Memory");
  m.attr("RECORDS") = all;
}

}  // namespace hcbf
