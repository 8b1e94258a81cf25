// What a filter reads, writes and remembers: constants, plants with their scenes, their reports, and room for
// one problem. `bindings/layouts.cpp` describes the records to NumPy.
#pragma once
#include <array>
#include <vector>

#include <hcbf/axle.hpp>
#include <hcbf/class_k.hpp>
#include <hcbf/program_records.hpp>

// What a plant's record remembers from step to step; zeros at a reset.
namespace hcbf::monitor {

struct Inputs {    // those that arrive, against those that were chosen
  double error;    // E
  double missed;   // the share of misses
  double exact;    // the share that was met exactly
  double off;      // the share that was off by more than an exact plant ever is
  double samples;  // that count
};

struct Motion {      // against the prediction; r and m' of models that are not planar stand elsewhere
  double drift[2];   // r [m]
  double motion[2];  // m' [m]
  double body[4];    // position [m] and velocity [m/s] at the last sample
  double bend;       // c
  double in_a_row;   // samples at which the motion was off
};

}  // namespace hcbf::monitor

namespace hcbf::conclusion {

// What changed: barriers, compared with those before or not; or the state comes after an invalid one.
enum Change : Index { COMPARED = 1, CHANGED = 2 };

struct Memory {
  Index change;    // a `Change`, 0 for nothing
  double kept;     // the least h - m at this sample [m]; after a change, of the barriers before
  double headway;  // the least psi likewise [m/s]
  Index unproved;  // whether a change left something short, until nothing is
  double closing;  // for how long psi has been below zero [s]
};

}  // namespace hcbf::conclusion

namespace hcbf::gatekeeper {

// A manoeuvre: towards a velocity for so many samples, then to rest; or a law of the user's.
struct Law {
  double target[2];  // [m/s]
  Index samples;     // for how many more
  Index own;         // 1 + which one of the user's; 0 for none
  Index begun;       // for how many samples that has been followed
};

// What is reserved along manoeuvres of one sample; docs/gatekeeper.md derives it.
struct Reserve {
  double keep;    // m_keep of regions [m]
  double ahead;   // m_accept − m_keep at the next sample [m]
  double drift;   // by how much that grows, and what a speed limit reserves more [m/s]
  double speed;   // m_keep of speed limits [m/s]
  double faster;  // by how much that grows until the next sample
};

// The manoeuvre that was verified last; `rank` is 0 where there was none since the reset.
struct Memory {
  Law law;
  Reserve reserve;
  Index rank;   // through which rank it is verified
  Index sure;   // whether an input was accepted since there was none, so that it goes on from that
  double lost;  // for how long no state has been valid [s]
};

}  // namespace hcbf::gatekeeper

// The fields of info["safety_filter"].
namespace hcbf::report {

struct Plant {  // (n_u,) u_nominal and u_safe stand behind it
  double intervention;  // |u - u*|
  double fallbacks;     // projections that took more than doubles or a second solver
  double model_error;   // how far the response is from the chosen input [unit of u]
  double reachable;     // through which rank the path leads; 0 where nothing lies on it
  double deadlock;      // 1 where the plant is at rest though u* requests motion
  double alpha1_scale;  // by how much alpha_1 was scaled down to what U can brake
  Index status;         // a `programs.FilterStatus`
  Index reason;         // a `reason::Reason`
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
};

// N of them, by field.
struct Plants {
  Matrix<const Index> kind;
  Cube<const double> parameters;
  Matrix<const Index> priority;
  Matrix<const double> own_margin;
  Cube<const double> own;  // see `general_rows.hpp`
  Records<Plant> sensed;
  Records<report::Plant> reports;
  Matrix<report::Row> rows;
  Index n_u;
  Matrix<const double> ends{nullptr, 0, 0};  // see `One`
};

// Room for the rows of one plant, and for the program's answer; it grows with the scene and is kept.
struct Work {
  Vector<double> u;         // (n_u,) the input that the program is given as the nominal one
  Matrix<double> a;         // (M, n_u) gradients
  Matrix<double> rows;      // (4, M) b, h, alpha2(psi) and psi
  Vector<Index> priority;   // (M,)
  Matrix<double> margin;    // (4, m) as `margins::derive` writes them
  Vector<Index> strict;     // (m,) 1 for those of rank 1 and on the position
  Matrix<double> straight;  // (M, 3) a and b of the rows on the acceleration, of differential drives
  struct {
    Vector<double> u, slack, delta;  // (n_u,), (M,), (M,)
    Index status, fallbacks;
  } answer;  // of the program, see `program_records::FilterResult`
  program_records::Workspace polygons;
  double corners[8];  // (4, 2) the U of a differential drive
  // the same once more, for the point before an axle, or for its second problem
  Matrix<double> other_a, other_rows, other_margin;

  // where these numbers are, and the shape that there is room for
  std::vector<double> numbers;
  std::vector<Index> codes;
  std::array<Index, 4> shape{-1, -1, -1, -1};
};

}  // namespace hcbf::plants
