// Records of NumPy structured arrays, which Python passes as the numbers that they are made of.
#pragma once
#include "bindings.hpp"

namespace hcbf {

using Words = Numbers<double, 2>;  // N records as rows of numbers: `arrays.numbers_of`
using Word = Numbers<double, 1>;   // a single record: its `.view(np.float64)`

template <class T>
Records<T> records(const Words& words) {
  return {reinterpret_cast<char*>(words.data()), static_cast<Index>(words.shape(0)),
          static_cast<Index>(words.shape(1) * sizeof(double))};
}

template <class T>
T& record(const Word& word) {
  return *reinterpret_cast<T*>(word.data());
}

}  // namespace hcbf
