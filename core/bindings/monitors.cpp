#include <hcbf/nearness.hpp>

#include "bindings.hpp"

namespace nanobind::detail {
using hcbf::Cube, hcbf::Index, hcbf::Matrix;
template <>
struct type_caster<hcbf::nearness::Scenes>
    : tuple_caster<hcbf::nearness::Scenes, Matrix<const Index>, Cube<const double>> {};
}  // namespace nanobind::detail

namespace hcbf {

void bind_monitors(nb::module_& m) {
  m.def("nearness_find_beside", &nearness::find_beside, "before"_a, "now"_a, "earlier"_a, "t"_a, "found"_a,
  "Write which regions of the scenes before were those of the scenes now.");
}

}  // namespace hcbf
