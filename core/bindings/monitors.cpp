#include "bindings.hpp"

namespace hcbf {

void bind_monitors(nb::module_&) {}

}  // namespace hcbf
