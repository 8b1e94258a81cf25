#include "bindings.hpp"

namespace hcbf {

void bind_programs(nb::module_&) {}

}  // namespace hcbf
