#include "bindings.hpp"

namespace hcbf {

void bind_guidance(nb::module_&) {}

}  // namespace hcbf
