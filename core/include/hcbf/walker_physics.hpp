// What the simulation of a walker reports of it.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::walker_physics {

// Whether a state holds nothing but finite numbers.
inline bool finite(Vector<const double> positions, Vector<const double> velocities) {
  const auto all = [](Vector<const double> a) {
    return std::all_of(a.data, a.data + a.size, [](double x) { return std::isfinite(x); });
  };
  return all(positions) && all(velocities);
}

}  // namespace hcbf::walker_physics
