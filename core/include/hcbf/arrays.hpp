// Views of arrays that lie in rows, as NumPy hands them over; none owns its memory.
#pragma once
#include <cmath>
#include <cstdint>

namespace hcbf {

using Index = std::int64_t;

template <class T>
struct Vector {  // (n,)
  T* data;
  Index size;
  operator Vector<const T>() const { return {data, size}; }
  T& operator[](Index i) const { return data[i]; }
  T* begin() const { return data; }
  T* end() const { return data + size; }
  Vector part(Index first, Index end) const { return {data + first, end - first}; }
};

template <class T>
struct Matrix {  // (n, m)
  T* data;
  Index rows, columns;
  operator Matrix<const T>() const { return {data, rows, columns}; }
  T& operator()(Index i, Index j) const { return data[i * columns + j]; }
  Vector<T> operator[](Index i) const { return {data + i * columns, columns}; }
  Matrix part(Index first, Index end) const { return {data + first * columns, end - first, columns}; }
};

template <class T>
struct Cube {  // (l, n, m)
  T* data;
  Index layers, rows, columns;
  operator Cube<const T>() const { return {data, layers, rows, columns}; }
  T& operator()(Index i, Index j, Index k) const { return data[(i * rows + j) * columns + k]; }
  Matrix<T> operator[](Index i) const { return {data + i * rows * columns, rows, columns}; }
  Cube part(Index first, Index end) const { return {data + first * rows * columns, end - first, rows, columns}; }
};

inline bool are_finite(Vector<const double> numbers) {
  for (const double x : numbers)
    if (!std::isfinite(x)) return false;
  return true;
}

inline void copy(Vector<const double> from, Vector<double> to) {
  for (Index k = 0; k < to.size; ++k) to[k] = from[k];
}

// (n,) records of a NumPy structured array; what differs in length from model to model stands behind
// the fields of T, so that records lie `stride` bytes apart.
template <class T>
struct Records {
  char* data;
  Index size, stride;
  T& operator[](Index i) const { return *reinterpret_cast<T*>(data + i * stride); }
  double* tail(Index i) const { return reinterpret_cast<double*>(data + i * stride + sizeof(T)); }
};

}  // namespace hcbf
