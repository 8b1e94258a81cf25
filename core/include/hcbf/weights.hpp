// The price of a relaxed row: lambda(h) = gamma0 where h > 0, else gamma0 (1 + delta_gamma |h|).
#pragma once
#include <algorithm>
#include <limits>

#include <hcbf/arrays.hpp>
#include <hcbf/dual.hpp>

namespace hcbf::weights {

// Returns gamma0 of a priority; infinity for a strict level. `table` (1 + L,): delta_gamma, then
// gamma0 of each priority from 2 on, the last one repeated.
inline double gamma0_of(Vector<const double> table, Index priority) {
  if (priority <= 1) return std::numeric_limits<double>::infinity();
  return table[std::min(priority - 1, table.size - 1)];
}

// Returns lambda(h) of one row; infinity for one of a strict level.
template <class Number>
Number weight_of(Vector<const double> table, Index priority, const Number& h) {
  using namespace functions;
  return gamma0_of(table, priority) * (1.0 + table[0] * max(0.0, -h));
}

}  // namespace hcbf::weights
