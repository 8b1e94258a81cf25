// How far a plant may be from its model: `models.plant.Uncertainty`, field by field.
#pragma once

namespace hcbf {

struct Uncertainty {
  double distance;            // d [m]
  double per_velocity;        // k_v [s]
  double per_lead;            // k_p
  double cap;                 // the most that a tracking error takes [m]
  double confidence;          // kappa
  double body;                // rho, how far the body reaches [m]
  double speed;               // d_s [m/s]
  double speed_per_velocity;  // k_s
};

}  // namespace hcbf
