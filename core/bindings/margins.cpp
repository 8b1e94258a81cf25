#include "bindings.hpp"

namespace hcbf {

void bind_margins(nb::module_&) {}

}  // namespace hcbf
