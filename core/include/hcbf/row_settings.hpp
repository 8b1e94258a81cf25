// How barriers become rows a·u ≥ b: α₁, α₂, that of speeds, and for how long an input is held.
#pragma once
#include <cstddef>

#include <hcbf/class_k.hpp>

namespace hcbf::row_settings {

struct RowSettings {  // the (19,) numbers of `RowSettings.packed` in Python
  class_k::ClassK alpha1, alpha2;
  class_k::ClassK alpha_speed;  // of speed limits and zones, on h itself
  double period;           // T [s]
  double u_max;            // the largest norm of an input [m/s²]; 0 where U is not known
  double held;             // 1 for rows of an input that is held for T, else 0
  double low[2], high[2];  // the least and the greatest inputs [m/s²]
};
static_assert(sizeof(RowSettings) == 19 * sizeof(double));

template <class Number>
struct RowOf {
  Number b;
  Number alpha2_psi;  // α₂(ψ)
  Number psi;         // ψ
};
using Row = RowOf<double>;

template <class Number>
struct PlacedRow {  // on the position
  Number b, alpha2_psi, psi;
  Number lost;  // by how much less h − m gains with every input than a·u [m/s²]
};

}  // namespace hcbf::row_settings

namespace hcbf {
using row_settings::RowSettings;
}
