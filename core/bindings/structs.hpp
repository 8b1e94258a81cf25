// Small structs as Python passes them.
#pragma once
#include <hcbf/axle.hpp>
#include <hcbf/class_k.hpp>

#include "bindings.hpp"

namespace nanobind::detail {

template <>
struct type_caster<hcbf::class_k::ClassK> : numbers_caster<hcbf::class_k::ClassK, 4> {};
template <>
struct type_caster<hcbf::RowSettings> : numbers_caster<hcbf::RowSettings, 19> {};
template <>
struct type_caster<hcbf::Uncertainty> : numbers_caster<hcbf::Uncertainty, 8> {};
template <>
struct type_caster<hcbf::axle::Axle> : tuple_caster<hcbf::axle::Axle, double, double, double, double> {};

}  // namespace nanobind::detail
