#include "bindings.hpp"

namespace hcbf {

void bind_barriers(nb::module_&) {}

}  // namespace hcbf
