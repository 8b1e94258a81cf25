// Division of numbers as Python rounds it: down, so that remainders have the divisor's sign.
#pragma once
#include <cmath>

namespace hcbf::floor_division {

inline double remainder(double a, double b) {
  const double rest = std::fmod(a, b);
  if (rest == 0.0) return std::copysign(0.0, b);
  return (b < 0.0) != (rest < 0.0) ? rest + b : rest;
}

inline double quotient(double a, double b) {
  const double rest = std::fmod(a, b);
  double whole = (a - rest) / b;
  if (rest != 0.0 && (b < 0.0) != (rest < 0.0)) whole -= 1.0;
  if (whole == 0.0) return std::copysign(0.0, a / b);
  const double floored = std::floor(whole);
  return whole - floored > 0.5 ? floored + 1.0 : floored;
}

}  // namespace hcbf::floor_division
