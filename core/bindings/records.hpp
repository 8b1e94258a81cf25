// Records of NumPy structured arrays, which Python passes as the numbers that they are made of.
#pragma once
#include <algorithm>
#include <cstddef>

#include "bindings.hpp"

namespace hcbf {

using Words = Numbers<double, 2>;  // N records as rows of numbers: `arrays.numbers_of`
using Word = Numbers<double, 1>;   // a single record: `arrays.words_of`

template <class T>
Records<T> records(const Words& words) {
  return {reinterpret_cast<char*>(words.data()), static_cast<Index>(words.shape(0)),
          static_cast<Index>(words.shape(1) * sizeof(double))};
}

template <class T>
T& record(const Word& word) {
  return *reinterpret_cast<T*>(word.data());
}

using Given1 = Numbers<const double, 1>;
using Given2 = Numbers<const double, 2>;

// Numbers as a struct that consists of nothing else.
template <class T, class Given>
const T& as(const Given& numbers) {
  return *reinterpret_cast<const T*>(numbers.data());
}

// A new array with copies of numbers.
template <class... Sizes>
nb::ndarray<nb::numpy, double> copied(const double* from, Sizes... sizes) {
  return owned<double>(std::vector<double>(from, from + (static_cast<std::size_t>(sizes) * ...)),
                       {static_cast<std::size_t>(sizes)...});
}

}  // namespace hcbf
