// What every translation unit of the Python module shares.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <initializer_list>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/polygon.hpp>

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

// The input of a manoeuvre of the user's, whose `laws` Python has; see `manoeuvres::Own`.
polygon::Point gate_input(const void* laws, Index which, const double* x, Index begun);

void bind_gatekeeper(nb::module_& m);
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

namespace nanobind::detail {

// A view as an argument is an array of its type, in rows, without data for None. It is never a copy where
// it is written to.
template <class View, class T, int N>
struct view_caster {
  using Array = make_caster<hcbf::Numbers<T, N>>;
  NB_TYPE_CASTER(View, Array::Name)

  bool from_python(handle src, uint32_t flags, cleanup_list* cleanup) noexcept {
    value = {};
    if (src.is_none()) return flags & cast_flags::accepts_none;
    if (!std::is_const_v<T>) flags &= ~static_cast<uint32_t>(cast_flags::convert);
    if (!array.from_python(src, flags, cleanup)) return false;
    value = hcbf::view(array.value);
    return true;
  }

 private:
  Array array;  // alive as long as the view
};
template <class T>
struct type_caster<hcbf::Vector<T>> : view_caster<hcbf::Vector<T>, T, 1> {};
template <class T>
struct type_caster<hcbf::Matrix<T>> : view_caster<hcbf::Matrix<T>, T, 2> {};
template <class T>
struct type_caster<hcbf::Cube<T>> : view_caster<hcbf::Cube<T>, T, 3> {};

// A struct as an argument is the tuple of its fields.
template <class Struct, class... Fields>
struct tuple_caster {
  using Tuple = make_caster<std::tuple<Fields...>>;
  NB_TYPE_CASTER(Struct, Tuple::Name)

  bool from_python(handle src, uint32_t flags, cleanup_list* cleanup) noexcept {
    if (!tuple.from_python(src, flags, cleanup)) return false;
    value = std::apply([](auto... fields) { return Struct{fields...}; },
                       static_cast<std::tuple<Fields...>>(tuple));
    return true;
  }

 private:
  Tuple tuple;
};

// A struct of numbers is an array of them, of the given shape, which is copied.
template <class Struct, ssize_t... Shape>
struct numbers_caster {
  using Array = make_caster<ndarray<const double, shape<Shape...>, c_contig, device::cpu>>;
  NB_TYPE_CASTER(Struct, Array::Name)
  static_assert(sizeof(Struct) == (Shape * ...) * sizeof(double));

  bool from_python(handle src, uint32_t flags, cleanup_list* cleanup) noexcept {
    if (!array.from_python(src, flags, cleanup)) return false;
    value = *reinterpret_cast<const Struct*>(array.value.data());
    return true;
  }

  static handle from_cpp(const Struct& numbers, rv_policy, cleanup_list* cleanup) noexcept {
    const auto* first = reinterpret_cast<const double*>(&numbers);
    auto copy = hcbf::owned<double>(std::vector<double>(first, first + (Shape * ...)), {std::size_t{Shape}...});
    return make_caster<decltype(copy)>::from_cpp(copy, rv_policy::automatic, cleanup);
  }

 private:
  Array array;
};

// A record as an argument is its numbers, which may be written to.
template <class Struct>
struct record_caster {
  using Array = make_caster<ndarray<double, shape<sizeof(Struct) / sizeof(double)>, c_contig, device::cpu>>;
  static constexpr auto Name = Array::Name;
  template <class T>
  using Cast = Struct&;
  template <class T>
  static constexpr bool can_cast() {
    return true;
  }

  bool from_python(handle src, uint32_t, cleanup_list* cleanup) noexcept {
    return array.from_python(src, 0, cleanup);
  }
  explicit operator Struct&() { return *reinterpret_cast<Struct*>(array.value.data()); }

 private:
  Array array;
};

}  // namespace nanobind::detail
