// What a filter reads and writes: constants, plants with their scenes, and their reports.
// `bindings/layouts.cpp` describes the records to NumPy.
#pragma once
#include <hcbf/axle.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/memory.hpp>
#include <hcbf/program_records.hpp>
#include <hcbf/report.hpp>
#include <hcbf/row_settings.hpp>
#include <hcbf/uncertainty.hpp>

namespace hcbf::plants {

struct Constants {
  // the program, as `program_records::Settings` has it
  program_records::Lower lower;
  bool by_level;
  program_records::Lock lock;
  bool ranks, guided;
  double radius, lambda_u;
  bool known_offset;
  Index corners;     // of a U
  Index weights;     // of a state
  bool made;         // whether rows, alarms and braking inputs were made beforehand
  // what rows reserve, and how they are made
  Uncertainty uncertainty;
  RowSettings rows;
  double period;    // T [s], 0 where it is not known
  double rounding;  // of an input that is applied in 32 bits, 0 for 64 [m/s^2]
  double dip;       // what usual rows reserve against dips between samples
  double tracking;  // what of d a robot may use that is not its model
  double settles;   // how long the robot takes to follow [s], 0 for its model
  // a differential drive
  bool drives;
  axle::Axle axle;
  RowSettings axle_rows;  // of rows on the axle
  double jerk;            // what these reserve of the acceleration [m/s^2]
  // guidance
  bool has_way;
  Index through;  // the highest rank that is relaxed for guidance, 0 for none
  bool brakes;    // whether an alarm makes the filter brake
  bool observed;  // whether states were measured, and are compared here
  // a gatekeeper
  bool gates;
  Index directions;       // into how many its manoeuvres accelerate
  Index laws;             // how many manoeuvres are the user's
  double position_error;  // of a state, besides its covariance [m]
  double velocity_error;  // [m/s]
  double longest;         // for how long the last manoeuvre goes on without a valid state [s]
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
  monitor::Inputs inputs;
  monitor::Motion motion;
  double expected[2];  // velocity of the model at the last sample [m/s]
  double vague[3];     // xx, xy and yy of its covariance at the last sample [m^2/s^2]
  double growth;       // what that grew by when it grew last [m^2/s^2]
  double accepted[4];  // the last state that was valid
  double headed;       // the heading then [rad]
  double accepted_at;  // its time [s]
  Index follows;       // whether the last sample was valid
  Index known;         // whether any was, since the reset
  conclusion::Memory judged;
  gatekeeper::Memory verified;
  Index alarm;  // a `Reason`, until the next reset
  Index moves;  // whether a region is nearer than its velocity explains
};

// One plant, its conditions and its report.
struct One {
  Vector<const Index> kind;         // (m,) as `BarrierSet` holds it
  Matrix<const double> parameters;  // (m, WIDTH)
  Vector<const Index> priority;     // (m,)
  Vector<const double> own_margin;  // (m,)
  Matrix<const double> own;         // (m, WIDTH + n_u) rows that were made beforehand; empty without
  Plant& plant;                     // written to
  Vector<double> input, stop;       // (n_u,) behind it
  report::Plant& report;            // written to
  Vector<double> u_nominal, u_safe;  // (n_u,) behind it
  Vector<report::Row> rows;         // (M,) written to; M is m, and one more where guidance has a row
  Vector<const double> ends{nullptr, 0};  // (m,) when a region's path ends [s]; empty where none does

  Index count() const { return kind.size; }
};

// N of them, by field.
struct Plants {
  Matrix<const Index> kind;
  Cube<const double> parameters;
  Matrix<const Index> priority;
  Matrix<const double> own_margin;
  Cube<const double> own;  // see `barriers.general_kernels`
  Records<Plant> sensed;
  Records<report::Plant> reports;
  Matrix<report::Row> rows;
  Index n_u;
  Matrix<const double> ends{nullptr, 0, 0};  // see `One`

  One operator[](Index i) const {
    double *behind = sensed.tail(i), *reported = reports.tail(i);
    return {kind[i], parameters[i], priority[i], own_margin[i],
            own.layers > 0 ? own[i] : Matrix<const double>{nullptr, 0, 0},
            sensed[i], {behind, n_u}, {behind + n_u, n_u},
            reports[i], {reported, n_u}, {reported + n_u, n_u}, rows[i],
            ends.rows > 0 ? ends[i] : Vector<const double>{nullptr, 0}};
  }
};

// Returns whether the scenes are of as many plants and rows as there is room for, in sound ranks:
// nothing else here checks an index. `guided`: whether guidance has a row of its own.
inline bool fits(const Plants& p, bool guided) {
  const Index count = p.kind.rows, m = p.kind.columns;
  if (p.sensed.size != count || p.reports.size != count || p.rows.rows != count) return false;
  if (p.rows.columns < m + guided) return false;
  if (p.own.layers > 0 && (p.own.layers != count || p.own.rows != m)) return false;
  if (p.parameters.layers != count || p.parameters.rows != m || p.parameters.columns != layout::WIDTH)
    return false;
  if (p.priority.rows != count || p.priority.columns != m) return false;
  if (p.own_margin.rows != count || p.own_margin.columns != m) return false;
  if (p.ends.rows > 0 && (p.ends.rows != count || p.ends.columns != m)) return false;
  for (Index i = 0; i < count; ++i)
    for (Index k = 0; k < m; ++k) {
      const Index rank = p.priority(i, k);
      if (p.kind(i, k) == layout::NONE ? rank != 0 : rank < 1 || rank > layout::LOWEST_RANK) return false;
    }
  return true;
}

// Returns the program of plant i; `numbers` holds the corners of U, and behind them the weights of all
// plants or of one a plant.
inline program_records::Settings program_of(const Constants& c, Vector<const double> numbers, Index i) {
  const Index end = 2 * c.corners;
  const bool weighs = numbers.size - end > c.weights;  // each plant by its own
  return {c.lower,  c.by_level, c.lock,         c.ranks,
          c.guided, c.radius,   c.lambda_u,     c.known_offset,
          {numbers.data, 1, c.corners, 2},
          {numbers.data + end + (weighs ? c.weights * i : 0), 1, c.weights}};
}

}  // namespace hcbf::plants
