// Rows as the stages of a cascade for any number of inputs read them.
#pragma once
#include <cmath>

#include <hcbf/arrays.hpp>
#include <hcbf/weights.hpp>

namespace hcbf::stage_rows {

// Writes each row's stage, whether the stage meets it, and its weight: 1 where it does. `table`:
// see `weights`; by_level: whether each priority is a stage.
inline void staged(Vector<const double> table, bool by_level, Vector<const Index> priority,
                   Vector<const double> h, Vector<Index> stage, Vector<bool> strict, Vector<double> weight) {
  for (Index k = 0; k < h.size; ++k) {
    const double price = weights::weight_of(table, priority[k], h[k]);
    strict[k] = std::isinf(price);
    stage[k] = by_level ? priority[k] : strict[k] ? 1 : 2;
    weight[k] = strict[k] ? 1.0 : price;
  }
}

}  // namespace hcbf::stage_rows
