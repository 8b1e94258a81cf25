// Records of NumPy structured arrays, which Python passes as the numbers that they are made of.
#pragma once
#include "bindings.hpp"

namespace hcbf {

using Words = Numbers<double, 1>;  // `.view(np.float64)` of a structured array

// N of them; what differs in length stands behind the fields of each.
template <class T>
Records<T> records(const Words& words, Index count) {
  const auto bytes = static_cast<Index>(words.size() * sizeof(double));
  return {reinterpret_cast<char*>(words.data()), count, count > 0 ? bytes / count : Index{sizeof(T)}};
}

// A single one.
template <class T>
T& words_as(const Words& words) {
  return *reinterpret_cast<T*>(words.data());
}

}  // namespace hcbf
