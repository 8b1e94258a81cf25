#include "bindings.hpp"

namespace hcbf {

void bind_locomotion(nb::module_&) {}

}  // namespace hcbf
