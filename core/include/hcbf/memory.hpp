// What a plant's record remembers from step to step; zeros at a reset.
#pragma once
#include <hcbf/arrays.hpp>

namespace hcbf {

namespace monitor {

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

}  // namespace monitor

namespace conclusion {

// What changed: barriers, compared with those before or not; or the state comes after an invalid one.
enum Change : Index { COMPARED = 1, CHANGED = 2 };

struct Memory {
  Index change;    // a `Change`, 0 for nothing
  double kept;     // the least h - m at this sample [m]; after a change, of the barriers before
  double headway;  // the least psi likewise [m/s]
  Index unproved;  // whether a change left something short, until nothing is
  double closing;  // for how long psi has been below zero [s]
};

}  // namespace conclusion

namespace gatekeeper {

// A manoeuvre: towards a velocity for so many samples, then to rest; or a law of the user's.
struct Law {
  double target[2];  // [m/s]
  Index samples;     // for how many more
  Index own;         // 1 + which one of the user's; 0 for none
  Index begun;       // for how many samples that has been followed
};

// What is reserved along manoeuvres of one sample; docs/gatekeeper.md derives it.
struct Reserve {
  double keep;   // m_keep of regions [m]
  double ahead;  // m_accept − m_keep at the next sample [m]
  double drift;  // by how much that grows, and what a speed limit reserves more [m/s]
  double speed;  // m_keep of speed limits [m/s]
};

// The manoeuvre that was verified last; `rank` is 0 where there was none since the reset.
struct Memory {
  Law law;
  Reserve reserve;
  Index rank;   // through which rank it is verified
  Index sure;   // whether an input was accepted since there was none, so that it goes on from that
  double lost;  // for how long no state has been valid [s]
};

}  // namespace gatekeeper

}  // namespace hcbf
