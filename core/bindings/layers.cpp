// Rows and a program as one differentiable function.
#include <hcbf/gradient.hpp>

#include "planar_program.hpp"

namespace hcbf {
namespace {

using Line = Numbers<const double, 1>;
using Table = Numbers<const double, 2>;
using Integers = Numbers<const Index, 1>;

gradient::Scene scene_of(const PlanarProgram& program, const Integers& kind, const Integers& priority,
                         const Line& settings) {
  return {view(kind), view(priority), *reinterpret_cast<const RowSettings*>(settings.data()),
          program.settings()};
}

}  // namespace

void bind_layers(nb::module_& m) {
  m.def(
      "layer_filter",
      [](const PlanarProgram& program, const Integers& kind, const Integers& priority, const Line& settings,
         const Table& variables, const Line& t, const Numbers<double, 2>& u, const Numbers<Index, 1>& status,
         const Numbers<bool, 1>& degenerate) {
        return gradient::filter_batch(scene_of(program, kind, priority, settings), view(variables), view(t),
                                      view(u), view(status), view(degenerate));
      },
      "program"_a, "kind"_a, "priority"_a, "settings"_a, "variables"_a, "t"_a, "u"_a.noconvert(),
      "status"_a.noconvert(), "degenerate"_a.noconvert(), Unlocked(),
      "Write u (N, 2), status and degenerate (N,); return the first malformed state, or N.");
  m.def(
      "layer_pull_back",
      [](const PlanarProgram& program, const Integers& kind, const Integers& priority, const Line& settings,
         const Table& variables, const Line& t, const Table& w, const Numbers<double, 2>& out) {
        gradient::pull_back_batch(scene_of(program, kind, priority, settings), view(variables), view(t),
                                  view(w), view(out));
      },
      "program"_a, "kind"_a, "priority"_a, "settings"_a, "variables"_a, "t"_a, "w"_a, "out"_a.noconvert(),
      Unlocked(), "Write (∂u/∂variables)ᵀ w of N states, w (N, 2).");
}

}  // namespace hcbf
