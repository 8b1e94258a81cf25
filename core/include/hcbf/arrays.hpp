// Views of arrays that lie in rows, as NumPy hands them over; none owns its memory.
#pragma once
#include <cstdint>

namespace hcbf {

using Index = std::int64_t;

template <class T>
struct Vector {  // (n,)
  T* data;
  Index size;
  T& operator[](Index i) const { return data[i]; }
  Vector part(Index first, Index end) const { return {data + first, end - first}; }
};

template <class T>
struct Matrix {  // (n, m)
  T* data;
  Index rows, columns;
  T& operator()(Index i, Index j) const { return data[i * columns + j]; }
  Vector<T> operator[](Index i) const { return {data + i * columns, columns}; }
  Matrix part(Index first, Index end) const { return {data + first * columns, end - first, columns}; }
};

template <class T>
struct Cube {  // (l, n, m)
  T* data;
  Index layers, rows, columns;
  T& operator()(Index i, Index j, Index k) const { return data[(i * rows + j) * columns + k]; }
  Matrix<T> operator[](Index i) const { return {data + i * rows * columns, rows, columns}; }
  Cube part(Index first, Index end) const { return {data + first * rows * columns, end - first, rows, columns}; }
};

}  // namespace hcbf
