// A robot's commands, and what its response makes of them: the velocity v̂, and what of the path is unknown.
// `motion_monitor` has the law; here v̂ follows the commands, and v_b does so within the robot's braking.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::command_history {

constexpr Index HELD = 256;     // commands that are remembered: the delay's worth of the fastest controller
constexpr double PIECE = 0.05;  // over which a propagated robot turns around the mean of its headings [s]

struct Commands {
  double since[HELD];     // [s]
  double leads[HELD][3];  // what they lead to: gain × command, in the plane [m/s], turning
  Index ends[HELD];       // whether it is the end of a command that was not renewed
  Index count;            // of all commands
  Index acting;           // the number of the one that acts
  double velocity[2];     // v̂ in the robot's axes [m/s]
  double braked[2];       // v_b in the robot's axes [m/s]

  // When and what the command of a number was, and whether it ends one.
  double& at(Index number) { return since[number % HELD]; }
  double* moves(Index number) { return leads[number % HELD]; }
  Index& is_end(Index number) { return ends[number % HELD]; }
  Index oldest() const { return std::max<Index>(0, count - HELD); }
};

struct Response {
  double tau;        // [s]
  double delay;      // δ [s]
  double braking;    // how hard a stop brakes [m/s²]
  double overshoot;  // by how much the speed exceeds all commands [m/s]
};

struct Motion {
  double ahead, aside;  // in the robot's axes [m]
  double length() const { return std::hypot(ahead, aside); }
};

// Notes a robot's command from a time on [s], or that one ends then. `moves` (3,): what it leads to, gain ×
// command, in the plane [m/s] and turning [rad/s]; `ends`: whether a command ends that was not renewed.
inline void note(Commands& all, const double* moves, double time, bool ends) {
  while (all.count > 0 && all.at(all.count - 1) >= time - 1e-9) all.count -= 1;  // revoked
  all.acting = std::min(all.acting, all.count);
  all.at(all.count) = time, all.is_end(all.count) = ends;
  std::copy_n(moves, 3, all.moves(all.count));
  all.count += 1;
}

// How many commands act, or have acted, at a time [s].
inline Index acting_at(Commands& all, double delay, double time) {
  Index acting = all.count;
  while (acting > all.oldest() && all.at(acting - 1) + delay > time + 1e-9) acting -= 1;
  return acting;
}

// Calls visit(acting, span) for every span of time [s] in which the same command acts, `longest` at most.
template <class Visit>
void spans(Commands& all, double delay, double longest, double start, double end, Visit visit) {
  Index acting = acting_at(all, delay, start);
  for (double now = start, until = start; now < end; now = until) {
    while (acting < all.count && all.at(acting) + delay <= now + 1e-9) acting += 1;
    until = std::min(end, now + longest);
    if (acting < all.count) until = std::min(until, all.at(acting) + delay);
    visit(acting, until - now);
  }
}

// Lets v_b be where it is farther from the command that begins to act. Where the one before was not
// renewed in time, the robot may have continued by it, or have braked.
inline void renew(Commands& all, const Response& response, Index acting, double* velocity) {
  if (acting < 2) return;
  const Index last = acting - 1, end = acting - 2;
  if (all.is_end(last) != 0 || all.is_end(end) == 0) return;
  const double speed = std::hypot(velocity[0], velocity[1]);
  const double lost = response.braking * (all.at(last) - all.at(end));
  const double left = std::max(0.0, 1.0 - lost / std::max(speed, 1e-9));
  const double x = all.moves(last)[0], y = all.moves(last)[1];
  const double continued = std::hypot(x - velocity[0], y - velocity[1]);
  if (std::hypot(x - left * velocity[0], y - left * velocity[1]) > continued)
    velocity[0] *= left, velocity[1] *= left;
}

// Lets v_b (`velocity`, written to) follow what acts for a time `span` [s], and returns what is unknown of
// the path meanwhile [m]. `acting`: how many commands act, or have acted; `went`: ∫v̂ dt over it.
inline double doubt_of(Commands& all, const Response& response, Index acting, double span, Motion went,
                       double* velocity) {
  double x = 0.0, y = 0.0;
  if (acting > 0) {
    const Index last = acting - 1;
    x = all.moves(last)[0], y = all.moves(last)[1];
    if (all.is_end(last) != 0 && acting > 1) {  // it may still follow the one before
      const double* before = all.moves(acting - 2);
      return std::hypot(before[0], before[1]) * span;
    }
  }
  const double tau = std::max(response.tau, 1e-6);
  const double behind = std::hypot(x - velocity[0], y - velocity[1]);
  const double most = response.braking * tau;  // behind by no more it need not brake harder
  const double braking = std::min(span, std::max(0.0, behind - most) / response.braking);
  const double left = (behind - response.braking * braking) * std::exp(-(span - braking) / tau);
  double late = (behind - 0.5 * response.braking * braking) * braking;
  late += tau * (behind - response.braking * braking - left);
  const double to_x = (x - velocity[0]) / std::max(behind, 1e-9);
  const double to_y = (y - velocity[1]) / std::max(behind, 1e-9);
  velocity[0] = x - left * to_x, velocity[1] = y - left * to_y;
  const double off = std::hypot(went.ahead - x * span + late * to_x, went.aside - y * span + late * to_y);
  return off + response.overshoot * braking;
}

// Lets v̂ and v_b begin with a velocity that was measured now, in the robot's axes.
inline void begin(Commands& all, const Response& response, double now, Motion velocity) {
  all.acting = std::max(all.acting, acting_at(all, response.delay, now));
  all.velocity[0] = all.braked[0] = velocity.ahead;
  all.velocity[1] = all.braked[1] = velocity.aside;
}

// ∫c dt, where a robot without τ and δ moves from a time to another.
inline Motion at_once(Commands& all, double start, double end) {
  Motion path{0.0, 0.0};
  spans(all, 0.0, INFINITY, start, end, [&](Index acting, double span) {
    if (acting == all.oldest()) return;
    path.ahead += all.moves(acting - 1)[0] * span;
    path.aside += all.moves(acting - 1)[1] * span;
  });
  return path;
}

struct Followed {
  Motion path;    // ∫v̂ dt [m], in the robot's axes
  double length;  // ∫‖v̂‖ dt [m]
  double doubt;   // what is unknown: of commands not renewed, and of those beyond the robot's braking [m]

  void add(Motion went, double unknown) {
    path.ahead += went.ahead, path.aside += went.aside;
    length += went.length(), doubt += unknown;
  }
};

// Lets v̂ follow the commands from a time to another.
inline Followed follow(Commands& all, const Response& response, double start, double end) {
  const double tau = std::max(response.tau, 1e-6);
  Followed sum{{0.0, 0.0}, 0.0, 0.0};
  all.acting = std::max(all.acting, all.oldest());
  spans(all, response.delay, INFINITY, start, end, [&](Index acting, double span) {
    while (all.acting < acting) renew(all, response, ++all.acting, all.braked);
    double forward = 0.0, sideways = 0.0;
    if (all.acting > 0) forward = all.moves(all.acting - 1)[0], sideways = all.moves(all.acting - 1)[1];
    const double left = std::exp(-span / tau);
    const double x = all.velocity[0] - forward, y = all.velocity[1] - sideways;
    const Motion went{forward * span + x * tau * (1.0 - left), sideways * span + y * tau * (1.0 - left)};
    sum.add(went, doubt_of(all, response, all.acting, span, went, all.braked));
    all.velocity[0] = forward + x * left, all.velocity[1] = sideways + y * left;
  });
  return sum;
}

// Propagates a robot by its commands. `ahead`: of the point that follows before the centre [m]; `pose` (3,)
// and `twist` (3,): of the centre, at the time `since`, written to; `now`: the present [s].
inline Followed propagate(Commands& all, const Response& response, double ahead, double* pose, double* twist,
                          double since, double now) {
  const double tau = std::max(response.tau, 1e-6);
  double goal[3] = {}, moved[3] = {}, braked[2] = {twist[0], twist[1] + ahead * twist[2]};
  Followed sum{{0.0, 0.0}, 0.0, 0.0};
  Index renewed = acting_at(all, response.delay, since);
  spans(all, response.delay, PIECE, since, now, [&](Index acting, double span) {
    while (renewed < acting) renew(all, response, ++renewed, braked);
    if (acting > 0) {
      std::copy_n(all.moves(acting - 1), 3, goal);
      goal[1] -= ahead * goal[2];  // of the centre
    }
    const double left = std::exp(-span / tau);
    for (int k = 0; k < 3; ++k) {
      const double off = twist[k] - goal[k];
      moved[k] = goal[k] * span + off * tau * (1.0 - left), twist[k] = goal[k] + off * left;
    }
    const double middle = pose[2] + 0.5 * moved[2], cos = std::cos(middle), sin = std::sin(middle);
    pose[0] += cos * moved[0] - sin * moved[1];
    pose[1] += sin * moved[0] + cos * moved[1];
    pose[2] += moved[2];
    const Motion went{moved[0], moved[1] + ahead * moved[2]};
    sum.add(went, doubt_of(all, response, acting, span, went, braked));
  });
  return sum;
}

}  // namespace hcbf::command_history
