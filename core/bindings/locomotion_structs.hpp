// Vectors, matrices and records of locomotion as Python passes them.
#pragma once
#include <hcbf/locomotion_tick.hpp>

#include "records.hpp"

namespace nanobind::detail {

template <>
struct type_caster<hcbf::matrices::Vector2> : numbers_caster<hcbf::matrices::Vector2, 2> {};
template <>
struct type_caster<hcbf::matrices::Vector3> : numbers_caster<hcbf::matrices::Vector3, 3> {};
template <>
struct type_caster<hcbf::matrices::Matrix3> : numbers_caster<hcbf::matrices::Matrix3, 3, 3> {};
template <>
struct type_caster<hcbf::rotation::Quaternion> : numbers_caster<hcbf::rotation::Quaternion, 4> {};
template <>
struct type_caster<hcbf::locomotion_state::RobotState> : numbers_caster<hcbf::locomotion_state::RobotState, 41> {};
template <>
struct type_caster<hcbf::feet::Trunk>
    : tuple_caster<hcbf::feet::Trunk, hcbf::matrices::Vector3, hcbf::matrices::Vector3, double, double> {};
template <>
struct type_caster<hcbf::body_reference::BodyReference> : record_caster<hcbf::body_reference::BodyReference> {};
template <>
struct type_caster<hcbf::dynamics::Bodies> : record_caster<hcbf::dynamics::Bodies> {};
template <>
struct type_caster<hcbf::dynamics::Dynamics> : record_caster<hcbf::dynamics::Dynamics> {};
template <>
struct type_caster<hcbf::feet::FootTargets> : record_caster<hcbf::feet::FootTargets> {};
template <>
struct type_caster<hcbf::gait::Gait> : record_caster<hcbf::gait::Gait> {};
template <>
struct type_caster<hcbf::leg::FootKinematics> : record_caster<hcbf::leg::FootKinematics> {};
template <>
struct type_caster<hcbf::leg::LegGeometry> : record_caster<hcbf::leg::LegGeometry> {};
template <>
struct type_caster<hcbf::locomotion_tick::Memory> : record_caster<hcbf::locomotion_tick::Memory> {};
template <>
struct type_caster<hcbf::locomotion_tick::Settings> : record_caster<hcbf::locomotion_tick::Settings> {};
template <>
struct type_caster<hcbf::locomotion_tick::TickPlan> : record_caster<hcbf::locomotion_tick::TickPlan> {};
template <>
struct type_caster<hcbf::task_space::Workspace> : record_caster<hcbf::task_space::Workspace> {};
template <>
struct type_caster<hcbf::tasks::TaskAccelerations> : record_caster<hcbf::tasks::TaskAccelerations> {};

}  // namespace nanobind::detail
