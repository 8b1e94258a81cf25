#include "bindings.hpp"

namespace hcbf {

void bind_filter(nb::module_&) {}

}  // namespace hcbf
