// How a barrier is stored in the arrays that compiled code reads: a kind, an integer, and a block of
// WIDTH numbers. Small kinds are the shapes: each has a header, which names the columns of its block.
#pragma once
#include <hcbf/arrays.hpp>

namespace hcbf::layout {

// The kinds that are no shape.
constexpr Index SPEED_LIMIT = 100;
constexpr Index CUSTOM = 101;  // a user's own barrier, which Python evaluates
constexpr Index MAPPED = 102;  // a class of a map: pieces in the atlas of a set, a region …
constexpr Index ZONES = 103;   // … or speed zones
constexpr Index ZONE = 104;    // one zone as it is seen from one state
constexpr Index NONE = 105;    // no condition: it fills up the shorter scenes of a batch

constexpr Index LOWEST_RANK = 64;  // the largest number that a priority may be

constexpr int VELOCITY_X = 0, VELOCITY_Y = 1;    // of the frame of a shape [m/s]
constexpr int V_MAX = 2;                         // of a speed limit and of zones [m/s]
constexpr int PIECES = 3;                        // of a class of a map: where its pieces begin in the atlas
constexpr int KEPT = 4;                          // of zones: what is reserved around their cells [m]
constexpr int AWAY = 3, AWAY_X = 4, AWAY_Y = 5;  // of one zone: the distance to it [m], and its gradient
constexpr int WIDTH = 19;                        // the velocity, and what the longest shape needs

}  // namespace hcbf::layout
