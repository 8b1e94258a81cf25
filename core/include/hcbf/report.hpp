// The fields of info["safety_filter"]: `bindings/layouts.cpp` describes them to NumPy.
#pragma once
#include <hcbf/arrays.hpp>

namespace hcbf::report {

struct Plant {  // (n_u,) u_nominal and u_safe stand behind it
  double intervention;  // |u - u*|
  double fallbacks;     // projections that took more than doubles or a second solver
  double model_error;   // how far the response is from the chosen input [unit of u]
  double reachable;     // through which rank the path leads; 0 where nothing lies on it
  double deadlock;      // 1 where the plant is at rest though u* requests motion
  double alpha1_scale;  // by how much alpha_1 was scaled down to what U can brake
  Index status;         // a `programs.FilterStatus`
  Index reason;         // a `models.plant.Reason`
  Index covered;        // a `models.plant.Coverage`
  Index covered_by;     // why it is not 1, a `models.plant.CoveredBy`
  Index proved;         // 1 where h >= m and psi >= 0 of every strict condition on the position
  Index verified;       // through which rank a gatekeeper's manoeuvre satisfies the conditions; 0 for none
};

struct Row {
  double slack;         // the row's violation
  double delta;         // the program's own relaxation
  double margin;        // what the row reserves between h and zero
  double h;             // NaN where no state is valid, infinite where there is no condition nearby
  double psi;           // the last psi, which the row keeps from falling below zero; as h
  double conditioning;  // 0 where no input matters to the row, less than 1 near a kink
};

}  // namespace hcbf::report
