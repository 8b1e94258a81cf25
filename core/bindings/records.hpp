// Records of NumPy structured arrays, which Python passes as rows of numbers: `arrays.numbers_of`.
#pragma once
#include "bindings.hpp"

namespace hcbf {

template <class T>
Records<T> records(const Numbers<double, 2>& a) {
  return {reinterpret_cast<char*>(a.data()), static_cast<Index>(a.shape(0)),
          static_cast<Index>(a.shape(1) * sizeof(double))};
}

}  // namespace hcbf
