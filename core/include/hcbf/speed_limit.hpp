// A cap on the speed, h = (v_max² − ‖v‖²) / (2 v_max); its gradient is −v/v_max, its Hessian −1/v_max.
#pragma once

namespace hcbf::speed_limit {

template <class Number>
Number value(const Number& v_max, const Number& vx, const Number& vy) {
  return (v_max * v_max - vx * vx - vy * vy) / (2.0 * v_max);
}

}  // namespace hcbf::speed_limit
