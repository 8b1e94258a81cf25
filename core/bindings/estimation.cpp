#include "bindings.hpp"

namespace hcbf {

void bind_estimation(nb::module_&) {}

}  // namespace hcbf
