// Why a filter brakes, or has raised an alarm: `models.plant.Reason`, number by number.
#pragma once
#include <hcbf/arrays.hpp>

namespace hcbf::reason {

enum Reason : Index {
  NONE, STATE, AGE, CLOCK, BARRIERS, SOLVER, GOAL, INPUT, MOTION, SLIP, LAG, LIFT, RESPONSE, MOVES, UNVERIFIED
};

constexpr Index FIRST_ALARM = INPUT;  // below, the filter brakes for as long as the reason lasts

}  // namespace hcbf::reason
