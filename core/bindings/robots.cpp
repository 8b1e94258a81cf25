#include "bindings.hpp"

namespace hcbf {

void bind_robots(nb::module_&) {}

}  // namespace hcbf
