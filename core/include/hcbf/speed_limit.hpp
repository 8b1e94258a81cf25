// A cap on the speed, h = (v_max² − ‖v‖²) / (2 v_max); its gradient is −v/v_max, its Hessian −1/v_max.
#pragma once

namespace hcbf::speed_limit {

inline double value(double v_max, double vx, double vy) {
  return (v_max * v_max - vx * vx - vy * vy) / (2.0 * v_max);
}

}  // namespace hcbf::speed_limit
