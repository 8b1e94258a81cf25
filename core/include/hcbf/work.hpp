// Room for the rows of one plant, and for the program's answer; it grows with the scene and is kept.
#pragma once
#include <algorithm>
#include <array>
#include <memory>
#include <utility>
#include <vector>

#include <hcbf/program_records.hpp>
#include <hcbf/margins.hpp>
#include <hcbf/rows.hpp>

namespace hcbf::work {

// The margins (4, m) of one plant, entry by entry.
inline margins::Reserved reserved(Matrix<double> margin) {
  return {margin[margins::MARGIN].data, margin[margins::RATE].data, margin[margins::QUICKENING].data,
          margin[margins::USABLE].data};
}

class Work {
 public:
  Vector<double> u;          // (n_u,) the input that the program is given as the nominal one
  Matrix<double> a;          // (M, n_u) gradients
  Matrix<double> rows;       // (4, M) b, h, alpha2(psi) and psi
  Vector<Index> priority;    // (M,)
  Matrix<double> margin;     // (4, m) as `margins::derive` writes them
  Vector<bool> strict;       // (m,) which conditions are of rank 1 and on the position
  Matrix<double> straight;   // (M, 3) a and b of the rows on the acceleration, of differential drives
  program_records::FilterResult answer;  // of the program, with a leading 1
  program_records::Workspace polygons;
  double corners[8];  // (4, 2) the U of a differential drive
  // the same once more, for the point before an axle, or for its second problem
  Matrix<double> other_a, other_rows, other_margin;

  // Makes room for m conditions of n_u inputs, M rows with that of guidance, and a U with so many corners.
  void fit(Index m, Index total, Index n_u, double radius, Index vertices) {
    const std::array<Index, 4> shape{m, total, n_u, vertices};
    if (shape == shape_ && radius == polygons.radius) return;
    shape_ = shape;
    const auto room = [](auto& of, Index size) {
      if (static_cast<Index>(of.size()) < size) of.resize(2 * size);
      return of.data();
    };
    double* at = room(numbers_, 2 * n_u + total * (2 * n_u + 4 + 4 + 3 + 2) + 8 * m);
    const auto take = [&at](Index size) { return std::exchange(at, at + size); };
    u = {take(n_u), n_u}, a = {take(total * n_u), total, n_u};
    rows = {take(4 * total), 4, total}, margin = {take(4 * m), 4, m};
    straight = {take(3 * total), total, 3};
    other_a = {take(total * n_u), total, n_u}, other_rows = {take(4 * total), 4, total};
    other_margin = {take(4 * m), 4, m};
    Index* code = room(codes_, total + 2);
    priority = {code, total};
    answer = {{take(n_u), 1, n_u}, {take(total), 1, total}, {take(total), 1, total}, {code + total, 1},
              {code + total + 1, 1}};
    if (flags_size_ < m) flags_ = std::make_unique<bool[]>(flags_size_ = 2 * m);
    strict = {flags_.get(), m};
    polygons.grow(radius, vertices, total);
  }

  // The rows as a program reads them, with a leading 1.
  program_records::CbfRows problem(Matrix<const double> gradients, Vector<const double> b) const {
    const Index total = priority.size;
    return {{gradients.data, 1, total, gradients.columns},
            {b.data, 1, total},
            {rows[hcbf::rows::H].data, 1, total},
            {priority.data, 1, total},
            {rows[hcbf::rows::ALPHA2_PSI].data, 1, total}};
  }

 private:
  std::vector<double> numbers_;
  std::vector<Index> codes_;
  std::unique_ptr<bool[]> flags_;
  Index flags_size_ = -1;
  std::array<Index, 4> shape_{-1, -1, -1, -1};  // that there is room for
};

}  // namespace hcbf::work
