// The feet's plan: footholds and swings put together, one tick ahead.
#pragma once
#include <hcbf/body_reference.hpp>
#include <hcbf/foothold.hpp>
#include <hcbf/gait.hpp>
#include <hcbf/matrices.hpp>
#include <hcbf/swing.hpp>

namespace hcbf::feet {

using body_reference::BodyReference;
using foothold::Trunk;
using gait::FootPhases;
using gait::Gait;
using matrices::Matrix3;
using matrices::Vector2;
using matrices::Vector3;

// last share of the swing in which the foothold is held: it sways with the trunk's velocity, and a
// foot that chases it to the end lands at up to 1 m/s along the ground and slides
constexpr double SETTLED = 0.3;

struct FootTargets {    // what each foot shall do, in the world
  bool stance[4];       // feet that carry; the others follow their swing
  Matrix3 motion[4];    // per foot the rows position [m], velocity [m/s], acceleration [m/s²]
  Vector2 foothold[4];  // where it shall land, or stands [m]
};

// Lets a foot carry where it is.
inline void stand(FootTargets& targets, int foot, const Vector3& place) {
  targets.stance[foot] = true;
  targets.motion[foot] = {{place, {}, {}}};
  targets.foothold[foot] = {place[0], place[1]};
}

struct Places {
  Vector3 measured[4];  // of the feet in the world [m]
  Vector2 nominal[4];   // footholds at rest in the trunk's axes [m]
  double touchdown;     // height of a foot's centre on the ground [m]
};

// Moves the targets on by one tick.
inline void plan_feet(FootTargets& targets, const FootPhases& phases, const Gait& gait, const Places& places,
                      const Trunk& trunk, const BodyReference& reference, double dt) {
  const double stance_time = gait.duty * gait.period;
  const double swing_time = (1.0 - gait.duty) * gait.period;
  for (int foot = 0; foot < 4; ++foot) {
    if (phases.stance[foot]) {
      stand(targets, foot, places.measured[foot]);
      continue;
    }
    const double remaining = phases.remaining[foot];
    if (remaining > SETTLED * swing_time)
      targets.foothold[foot] =
          foothold::foothold(places.nominal[foot], trunk, reference, remaining, stance_time);
    targets.stance[foot] = false;
    targets.motion[foot] = swing::swing_step(targets.motion[foot], targets.foothold[foot], places.touchdown,
                                             remaining, swing_time, dt);
  }
}

}  // namespace hcbf::feet
