#include "bindings.hpp"

namespace hcbf {

void bind_models(nb::module_&) {}

}  // namespace hcbf
