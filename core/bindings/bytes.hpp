// Records of NumPy's structured arrays as they come from Python, small arrays on their way back, and
// which bytes hold which field.
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "bindings.hpp"

namespace hcbf {

using Bytes = Numbers<std::uint8_t, 1>;  // `.view(np.uint8)` of a structured array

template <class T>
T& record(const Bytes& bytes) {
  return *reinterpret_cast<T*>(bytes.data());
}

using Given1 = Numbers<const double, 1>;
using Given2 = Numbers<const double, 2>;

// A row of numbers as a struct that consists of nothing else.
template <class T, class Given>
const T& as(const Given& numbers) {
  return *reinterpret_cast<const T*>(numbers.data());
}

// A new array with copies of numbers.
template <class... Sizes>
nb::ndarray<nb::numpy, double> copied(const double* from, Sizes... sizes) {
  const std::size_t shape[] = {static_cast<std::size_t>(sizes)...};
  const std::size_t count = (static_cast<std::size_t>(sizes) * ...);
  auto* data = new double[count];
  std::copy(from, from + count, data);
  const nb::capsule owner(data, [](void* pointer) noexcept { delete[] static_cast<double*>(pointer); });
  return {data, sizeof...(sizes), shape, owner};
}

struct FieldOffset {
  const char* name;
  std::size_t offset;
};

#define FIELD(T, field) \
  hcbf::FieldOffset { #field, offsetof(T, field) }

// (size, {field: offset}) of a record.
inline nb::tuple layout_of(std::size_t size, const std::vector<FieldOffset>& fields) {
  nb::dict offsets;
  for (const FieldOffset& field : fields) offsets[field.name] = field.offset;
  return nb::make_tuple(size, offsets);
}

}  // namespace hcbf
