#include "bindings.hpp"

namespace hcbf {

void bind_scenarios(nb::module_&) {}

}  // namespace hcbf
