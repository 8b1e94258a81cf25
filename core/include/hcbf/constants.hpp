// Constants of nature, and numbers that Python reads here, too: `models.constants`.
#pragma once

namespace hcbf::constants {

constexpr double GRAVITY = 9.81;   // on the ground [m/s²]
constexpr double FARTHEST = 1e4;   // of anything from the origin [m]
constexpr double STANDING = 0.05;  // slower than that a robot is at rest [m/s]
constexpr double ASKING = 0.3;     // a larger nominal input requests motion [m/s²]

}  // namespace hcbf::constants
