// A program of two inputs as Python holds it; it is bound in programs.cpp.
#pragma once
#include <hcbf/cascade.hpp>
#include <vector>

#include "bindings.hpp"

namespace hcbf {

template <class T>
using OneOrMany = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;  // of one state, or N

// A program of two inputs with its prices and U; its arrays are copies.
class PlanarProgram {
 public:
  PlanarProgram(Index lower, bool by_level, Index lock, bool ranks, bool guided, double radius,
                double lambda_u, bool known_offset, const Numbers<const double, 3>& vertices,
                const Numbers<const double, 2>& weights)
      : vertices_(vertices.data(), vertices.data() + vertices.size()),
        weights_(weights.data(), weights.data() + weights.size()),
        settings_{static_cast<program_records::Lower>(lower), by_level,
                  static_cast<program_records::Lock>(lock), ranks, guided, radius, lambda_u, known_offset,
                  view(vertices), view(weights)} {
    settings_.vertices.data = vertices_.data();
    settings_.weights.data = weights_.data();
  }
  PlanarProgram(const PlanarProgram&) = delete;

  // Filters N states into `answer`, u, slack, delta and status one after the other; false where u* or
  // a row is malformed.
  bool filter(const OneOrMany<double>& u_nominal, const OneOrMany<double>& a, const OneOrMany<double>& b,
              const OneOrMany<double>& h, const OneOrMany<Index>& priority,
              const OneOrMany<double>& alpha2_psi, const Numbers<double, 1>& answer) const {
    const Index n = u_nominal.size() / 2, total = b.size(), m = n > 0 ? total / n : 0;
    const program_records::CbfRows rows{{a.data(), n, m, 2}, {b.data(), n, m}, {h.data(), n, m},
                                 {priority.data(), n, m}, {alpha2_psi.data(), n, m}};
    if (!are_finite({u_nominal.data(), 2 * n}) || !are_finite({alpha2_psi.data(), total}))
      return false;
    for (Index i = 0; i < n; ++i)
      if (!program_records::well_formed(rows[i])) return false;
    double *u = answer.data(), *slack = u + 2 * n, *delta = slack + total;
    std::vector<Index> codes(2 * n);
    const program_records::FilterResult found{
        {u, n, 2}, {slack, n, m}, {delta, n, m}, {codes.data(), n}, {codes.data() + n, n}};
    cascade::filter_batch(settings_, {u_nominal.data(), n, 2}, rows, found);
    std::copy_n(codes.begin(), n, delta + total);
    return true;
  }

  const program_records::Settings& settings() const { return settings_; }

 private:
  std::vector<double> vertices_, weights_;
  program_records::Settings settings_;
};

}  // namespace hcbf
