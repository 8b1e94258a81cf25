#include "bindings.hpp"

namespace hcbf {

void bind_maps(nb::module_&) {}

}  // namespace hcbf
