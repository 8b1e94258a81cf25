// Rows and a program as one differentiable function.
#include <hcbf/gradient.hpp>

#include "planar_program.hpp"
#include "structs.hpp"

namespace hcbf {
namespace {

using Line = Vector<const double>;
using Table = Matrix<const double>;
using Integers = Vector<const Index>;

gradient::Scene scene_of(const PlanarProgram& program, const Integers& kind, const Integers& priority,
                         const RowSettings& settings) {
  return {kind, priority, settings,
          program.settings()};
}

}  // namespace

void bind_layers(nb::module_& m) {
  m.def(
      "layer_filter",
      [](const PlanarProgram& program, const Integers& kind, const Integers& priority, const RowSettings& settings,
         const Table& variables, const Line& t, const Matrix<double>& u, const Vector<Index>& status,
         const Vector<bool>& degenerate) {
        return gradient::filter_batch(scene_of(program, kind, priority, settings), variables, t,
                                      u, status, degenerate);
      },
      "program"_a, "kind"_a, "priority"_a, "settings"_a, "variables"_a, "t"_a, "u"_a,
      "status"_a, "degenerate"_a, Unlocked(),
      "Write u (N, 2), status and degenerate (N,); return the first malformed state, or N.");
  m.def(
      "layer_pull_back",
      [](const PlanarProgram& program, const Integers& kind, const Integers& priority, const RowSettings& settings,
         const Table& variables, const Line& t, const Table& w, const Matrix<double>& out) {
        gradient::pull_back_batch(scene_of(program, kind, priority, settings), variables, t,
                                  w, out);
      },
      "program"_a, "kind"_a, "priority"_a, "settings"_a, "variables"_a, "t"_a, "w"_a, "out"_a,
      Unlocked(), "Write (∂u/∂variables)ᵀ w of N states, w (N, 2).");
}

}  // namespace hcbf
