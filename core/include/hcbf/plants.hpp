// What a filter never changes, and what is known of one plant: `filtering.plants` has the dtypes.
#pragma once
#include <hcbf/memory.hpp>
#include <hcbf/uncertainty.hpp>

namespace hcbf::plants {

constexpr Index SETTINGS_WIDTH = 15;  // `RowSettings.packed`

struct Constants {
  // the program, as `program_records::Settings` has it
  Index lower;
  bool by_level;
  Index lock;
  bool ranks, guided;
  double radius, lambda_u;
  bool known_offset;
  Index corners;     // of a U
  Index input_sets;  // 1, or one a plant
  Index weights;     // of a state
  bool made;         // whether rows, alarms and braking inputs were made beforehand
  // what rows reserve, and how they are made
  Uncertainty uncertainty;
  double rows[SETTINGS_WIDTH];
  double period;    // T [s], 0 where it is not known
  double rounding;  // of an input that is applied in 32 bits, 0 for 64 [m/s^2]
  double dip;       // what usual rows reserve against dips between samples
  double sway;      // what of d a robot may use that is not its model
  double settles;   // how long the robot takes to follow [s], 0 for its model
  // a differential drive
  bool drives;
  double axle[4];                    // `axle::Axle`
  double axle_rows[SETTINGS_WIDTH];  // of rows on the axle
  double jerk;                       // what these reserve of the acceleration [m/s^2]
  // guidance
  bool has_way;
  Index through;  // the highest rank that is relaxed for guidance, 0 for none
  bool brakes;    // whether an alarm makes the filter brake
  bool observed;  // whether states were measured, and are compared here
};

// Vectors of length 4 are those of the planar double integrator; those of other models stand beside
// the record, see `state_check::State`. Behind it stand (n_u,) `input`, applied since the last
// sample, and `stop`, of U, which brings a plant of another model to rest.
struct Plant {
  // what is known of it now, as `models.plant.Estimate` has it
  double x[4];
  double time;
  double model[4];
  double lag[4];
  double covariance[4][4];
  double elapsed;   // since the sample before [s]; 0 where that is not known
  Index fault;      // a `Reason` that was found on the way here; 0 for none
  Index has_model;  // whether the model has a state of its own; x is that if not
  double heading;   // of a differential drive [rad]
  // where guidance leads
  double way[3];     // a_x, a_y and b of its row
  Index turns;       // whether a differential drive turns to it, against u*
  double turn;       // by which acceleration across its heading then [m/s^2]
  double reachable;  // through which rank
  Index lost;        // whether it finds no path to the goal
  double zone;       // the rank of the map's zone that the plant is in, 0 for none
  // what is remembered from step to step
  monitor::Memory watched;
  monitor::PlanarMemory planar;
  double expected[2];  // velocity of the model at the last sample [m/s]
  double vague[3];     // xx, xy and yy of its covariance at the last sample [m^2/s^2]
  double growth;       // what that grew by when it grew last [m^2/s^2]
  double believed[4];  // the last state that was valid
  double headed;       // the heading then [rad]
  double believed_at;  // its time [s]
  Index follows;       // whether the last sample was valid
  Index known;         // whether any was, since the reset
  status::Memory judged;
  Index alarm;  // a `Reason`, until the next reset
  Index moves;  // whether a region is nearer than its velocity explains
};

}  // namespace hcbf::plants
