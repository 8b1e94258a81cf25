// Reasons to brake, and whether regions move.
#include <iterator>

#include <hcbf/nearness.hpp>
#include <hcbf/state_check.hpp>

#include "bindings.hpp"

namespace nanobind::detail {
using hcbf::Cube, hcbf::Index, hcbf::Matrix;
template <>
struct type_caster<hcbf::nearness::Scenes>
    : tuple_caster<hcbf::nearness::Scenes, Matrix<const Index>, Cube<const double>> {};
}  // namespace nanobind::detail

namespace hcbf {

void bind_monitors(nb::module_& m) {
  using reason::Reason, reason::WORDS;
  nb::enum_<Reason> reasons(m, "Reason", nb::is_arithmetic(),
                            R"(Why a filter brakes or has raised an alarm, and its `text`.

Below `INPUT` the filter brakes for as long as the reason lasts. From there on they are alarms: the
plant is not the one that was declared. They last until the next reset; MOVES, a reason of the
world, is decided at every step. So is UNVERIFIED, a gatekeeper's, which is none.)");
  for (std::size_t k = 0; k < std::size(WORDS); ++k)
    reasons.value(WORDS[k].name, static_cast<Reason>(k), WORDS[k].text);
  reasons.def_prop_ro("text", [](Reason why) { return WORDS[why].text; }, "The reason in words.");
  reasons.def_prop_ro("lasts", [](Reason why) { return reason::lasts(why); }, "Whether it lasts until the next reset.");
  m.attr("FIRST_ALARM") = reason::FIRST_ALARM;
  m.def("nearness_find_beside", &nearness::find_beside, "before"_a, "now"_a, "earlier"_a, "t"_a, "found"_a,
  "Write which regions of the scenes before were those of the scenes now.");
}

}  // namespace hcbf
