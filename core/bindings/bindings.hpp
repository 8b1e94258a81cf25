// What every translation unit of the Python module shares.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <initializer_list>
#include <utility>
#include <vector>

#include <hcbf/arrays.hpp>

namespace hcbf {

namespace nb = nanobind;
using namespace nb::literals;

// Arrays as Python hands them over: in rows, of one type, never converted.
template <class T, int N>
using Numbers = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

template <class T>
Vector<T> view(const Numbers<T, 1>& a) {
  return {a.data(), static_cast<Index>(a.shape(0))};
}
template <class T>
Matrix<T> view(const Numbers<T, 2>& a) {
  return {a.data(), static_cast<Index>(a.shape(0)), static_cast<Index>(a.shape(1))};
}
template <class T>
Cube<T> view(const Numbers<T, 3>& a) {
  return {a.data(), static_cast<Index>(a.shape(0)), static_cast<Index>(a.shape(1)), static_cast<Index>(a.shape(2))};
}

// A NumPy array of numbers that were computed here, which lie in `values` and which it keeps.
template <class T, class Entry>
nb::ndarray<nb::numpy, T> owned(std::vector<Entry>&& values, std::initializer_list<std::size_t> shape) {
  auto* kept = new std::vector<Entry>(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<Entry>*>(p); });
  return nb::ndarray<nb::numpy, T>(kept->data(), shape.size(), shape.begin(), owner);
}

// Lets other threads of Python run meanwhile.
using Unlocked = nb::call_guard<nb::gil_scoped_release>;

void bind_models(nb::module_& m);
void bind_programs(nb::module_& m);
void bind_barriers(nb::module_& m);
void bind_layers(nb::module_& m);
void bind_margins(nb::module_& m);
void bind_model_step(nb::module_& m);
void bind_filter(nb::module_& m);
void bind_layouts(nb::module_& m);
void bind_monitors(nb::module_& m);
void bind_guidance(nb::module_& m);
void bind_maps(nb::module_& m);
void bind_locomotion(nb::module_& m);
void bind_estimation(nb::module_& m);
void bind_robots(nb::module_& m);
void bind_envs(nb::module_& m);

}  // namespace hcbf
