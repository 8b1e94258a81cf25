// Does a robot move as its twist and its commands predict? Samples are compared at their own times.
//
// By its twist: `monitor` has the law. Where samples are missing, the position differs by u_max T²/4 at
// most. Positions may be noisy. With e = Δp − T (v + v')/2, white noise of the variance σ² correlates two
// successive e by −σ², and neither a drift nor a scale does. The mean of −e·e'/2 over SAMPLES samples, from
// NOISE² on, is the σ² that the bound allows for. Positions are averaged with the twist's predictions, over
// the time AVERAGED σ.
//
// By its commands: the response turns them into a velocity v̂ in the robot's own axes. Over every sample of
// length T, with Δp the motion of the point that follows, for windows W that double from W₀,
//   r ← (1 − T/W) r + Δp − ∫v̂ dt,   m ← (1 − T/W) m + ∫‖v̂‖ dt,   w ← (1 − T/W) w + T,
// and the alarm is raised where in any window ‖r‖ > D w + (K S − D) min(√(W₀ w), 2 W₀) + a m + d. Of an
// unmeasured robot the distance of r from the line to q ← (1 − T/W) q + ∫(c − v̂) dt is compared, and the
// bound grows by A ‖q‖. Over longer windows, with e the mean residual of a sample and J the quarter turn,
//   c ← (1 − T/W) c + T (e·v̂, e·Jv̂),   E ← (1 − T/W) E + T ‖v̂‖²,
// and the alarm is raised where in both ‖c‖ > a E + k K S √(W₀ E) + d'. The module
// `hcbf_robots.walkers.motion_monitor` derives the bounds.
#pragma once
#include <hcbf/command_history.hpp>
#include <hcbf/monitor.hpp>

namespace hcbf::motion_monitor {

using command_history::Motion;

constexpr Index WINDOWS = 7;      // each twice as long as the one before
constexpr double ADDS_UP = 2.0;   // over how many W₀ residuals add up
constexpr double FAST = 0.25;     // of the greatest speed: legs that are commanded less may be at rest
constexpr double COMPARED[2][2] = {{4.0, 16.0}, {1.0, 4.0}};  // windows [s], and at least so many W₀
constexpr double APART = 0.6;     // k: a gait, which is no answer to commands, hardly correlates with them
constexpr double FILLED = 0.6;    // share of the shortest window that must have been seen
constexpr double PAUSE = 0.5;     // between two samples, forth or back, after which all starts anew [s]
constexpr double LEAP = 0.2;      // that a position may be off within one sample [m] …
constexpr double FASTEST = 3.0;   // … beside so many times the greatest speed: beyond, it was put elsewhere
constexpr double TURN = 6.283185307179586;
constexpr double NOISE = 0.02, NOISIEST = 0.03;  // σ before any is known, and the greatest allowed for [m]
constexpr double SAMPLES = 100.0;                // over which it is averaged
constexpr double ALLOWED = 5.0;                  // standard deviations of a position in a bound …
constexpr double ALLOWED_AVERAGED = 2.0;         // … and of an averaged one
constexpr double AVERAGED = 40.0;                // time of averages for each metre of σ [s/m]
constexpr double ELSEWHERE = 0.2;                // from the average, beyond which it starts anew [m]

struct Position {       // where the robot is
  double missing;       // what the path may be off where samples are missing [m]
  double residual[2];   // e [m]
  double variance;      // NOISE² − σ² [m²]
  double average[2];    // the position, averaged [m]
  double deviation;     // σ of it [m]
};

struct Sums {                  // of what differs from the commands
  double strayed[WINDOWS][2];  // r [m]
  double moved[WINDOWS];       // m [m]
  double doubt[WINDOWS];       // d [m]
  double apart[WINDOWS][2];    // q [m]
  double widest[WINDOWS];      // the greatest ‖q‖ of late [m]
  double seen[WINDOWS];        // w [s]
  double correlated[2][2];     // c [m²/s]
  double power[2];             // E [m²/s]
  double hidden[2];            // d of it [m²/s]
};

struct Notes {
  command_history::Commands commands;
  monitor::Motion twist;
  Position position;
  Sums sums;
  double place[3];  // x, y [m] and heading [rad] at the last sample
  double time;      // of it [s]
  Index begun;      // whether there is one
  double worst;     // the greatest share of a bound on `sums` at the last sample
};

struct Law {
  command_history::Response response;
  double first;    // W₀ [s]
  double most;     // K S [m/s]
  double lasting;  // D [m/s]
  double share;    // a
  double arc;      // A; 0 of a robot that was measured
  double forward;  // the greatest speed that the robot may be commanded [m/s]
  double regular;  // the longest regular time between two samples [s]; 0: the twist is not compared
  double hardest;  // the greatest acceleration [m/s²]
};

// Lets the averaged position continue to a sample (4,), and returns σ of positions [m].
inline double average(Position& note, const double* last, const double* body, double passed) {
  const double known = NOISE * NOISE;
  const double e_x = body[0] - last[0] - 0.5 * passed * (body[2] + last[2]);
  const double e_y = body[1] - last[1] - 0.5 * passed * (body[3] + last[3]);
  const double seen = -0.5 * (e_x * note.residual[0] + e_y * note.residual[1]);
  double variance = known - note.variance;
  variance += (seen - variance) / SAMPLES;
  variance = std::min(std::max(variance, 0.0), NOISIEST * NOISIEST);
  note.variance = known - variance, note.residual[0] = e_x, note.residual[1] = e_y;
  const double sigma = std::sqrt(variance), left = note.deviation * note.deviation;
  double share = passed / (passed + AVERAGED * sigma);
  share = std::max(share, left / std::max(left + variance, 1e-12));  // the mean of the first few
  note.average[0] += body[0] - last[0] - e_x;
  note.average[1] += body[1] - last[1] - e_y;
  const double x = body[0] - note.average[0], y = body[1] - note.average[1];
  if (x * x + y * y > ELSEWHERE * ELSEWHERE) share = 1.0;
  note.average[0] += share * x;
  note.average[1] += share * y;
  note.deviation = std::sqrt((1.0 - share) * (1.0 - share) * left + share * share * variance);
  return sigma;
}

// Compares a sample (4,) with the twist, and returns whether that alarms. `continues`: whether there is one
// before it.
inline bool drifts(Notes& note, const Law& law, const double* body, double passed, bool continues) {
  Position& position = note.position;
  bool alarms = false;
  if (continues) {
    const double missed = passed > law.regular ? 0.25 * law.hardest * (passed * passed) : 0.0;
    position.missing = monitor::fade(passed) * position.missing + missed;
    const double besides = position.missing + ALLOWED * average(position, note.twist.body, body, passed);
    alarms = monitor::drifts(note.twist, body, passed, besides, false);
  } else {
    note.twist = {}, position.missing = position.residual[0] = position.residual[1] = 0.0;
    position.deviation = std::sqrt(NOISE * NOISE - position.variance);
    std::copy_n(body, 2, position.average);
  }
  std::copy_n(body, 4, note.twist.body);
  return alarms;
}

// What a robot's motion may be off over a time `seen` [s], in which its path was `moved` long [m].
inline double bound(const Law& law, double seen, double moved) {
  const double adding = std::min(std::sqrt(law.first * seen), ADDS_UP * law.first);
  return law.lasting * seen + std::max(0.0, law.most - law.lasting) * adding + law.share * moved;
}

// Adds a sample to r and q of every window, and returns the greatest share of its bound.
inline double strays(Sums& sums, const Law& law, Motion off, Motion apart,
                     const command_history::Followed& followed, double passed, double noise) {
  double worst = 0.0, window = law.first;
  for (Index i = 0; i < WINDOWS; ++i, window *= 2.0) {
    const double keep = std::max(0.0, 1.0 - passed / window);
    double *r = sums.strayed[i], *q = sums.apart[i];
    r[0] = keep * r[0] + off.ahead, r[1] = keep * r[1] + off.aside;
    sums.moved[i] = keep * sums.moved[i] + followed.length;
    sums.doubt[i] = keep * sums.doubt[i] + followed.doubt;
    sums.seen[i] = keep * sums.seen[i] + passed;
    q[0] = keep * q[0] + apart.ahead, q[1] = keep * q[1] + apart.aside;
    sums.widest[i] = std::max(std::hypot(q[0], q[1]), keep * sums.widest[i]);
    if (sums.seen[i] < FILLED * law.first) continue;
    double most = bound(law, sums.seen[i], sums.moved[i]) + sums.doubt[i] + noise, near = 0.0;
    if (sums.widest[i] > 0.0) {
      const double along = (r[0] * q[0] + r[1] * q[1]) / std::max(q[0] * q[0] + q[1] * q[1], 1e-12);
      near = std::min(1.0, std::max(0.0, along));
      most += law.arc * sums.widest[i];
    }
    worst = std::max(worst, std::hypot(r[0] - near * q[0], r[1] - near * q[1]) / most);
  }
  return worst;
}

// Adds a sample to c of both windows, and returns the lesser share of the bound.
inline double differs(Sums& sums, const Law& law, Motion off, Motion went, double passed, double hidden,
                      double noise) {
  const double least = FAST * law.forward;
  const bool fast = went.length() > least * passed;
  const double along = off.ahead * went.ahead + off.aside * went.aside;
  const double across = off.aside * went.ahead - off.ahead * went.aside;
  double worst = INFINITY;
  for (Index i = 0; i < 2; ++i) {
    const auto [seconds, times] = COMPARED[i];
    const double keep = std::max(0.0, 1.0 - passed / std::max(seconds, times * law.first));
    double *c = sums.correlated[i], &E = sums.power[i];
    c[0] = keep * c[0], c[1] = keep * c[1], E = keep * E;
    sums.hidden[i] = keep * sums.hidden[i] + hidden;
    if (fast) {
      c[0] += along / passed;
      c[1] += across / passed;
      E += (went.ahead * went.ahead + went.aside * went.aside) / passed;
    }
    if (E < least * least * law.first / APART)
      return 0.0;  // the shorter window begins where the longer one has seen enough
    const double most = law.share * E + APART * law.most * std::sqrt(law.first * E);
    worst = std::min(worst, std::hypot(c[0], c[1]) / (most + sums.hidden[i] + noise * law.forward));
  }
  return worst;
}

// Compares a sample with the commands, and returns whether that alarms. `pose` (3,): of the point that
// follows; `velocity` (2,): of it in the world; `noise`: what a position may be off [m]; `continues`:
// whether there is a sample before it.
inline bool differs_from_commands(Notes& note, const Law& law, const double* pose, const double* velocity,
                                  double time, double noise, bool continues) {
  const double passed = time - note.time;
  double turn = pose[2] - note.place[2];
  turn -= TURN * std::nearbyint(turn / TURN);
  const double middle = note.place[2] + 0.5 * turn, cos = std::cos(middle), sin = std::sin(middle);
  const double dx = pose[0] - note.place[0], dy = pose[1] - note.place[1];
  const Motion moved{cos * dx + sin * dy, cos * dy - sin * dx};
  std::copy_n(pose, 3, note.place);
  if (!continues || moved.length() > LEAP + FASTEST * law.forward * passed) {
    const double ahead = std::cos(pose[2]), aside = std::sin(pose[2]), vx = velocity[0], vy = velocity[1];
    const Motion own{ahead * vx + aside * vy, ahead * vy - aside * vx};
    command_history::begin(note.commands, law.response, time, own);
    note.sums = {};
    std::fill_n(note.sums.doubt, WINDOWS, 2.0 * noise);  // of the place where r begins
    return false;
  }
  command_history::Commands& commands = note.commands;
  double speed = std::hypot(commands.velocity[0], commands.velocity[1]);
  const auto followed = command_history::follow(commands, law.response, note.time, time);
  // the last command, and its end
  for (Index last = std::max<Index>(0, commands.count - 2); last < commands.count; ++last)
    speed = std::max(speed, std::hypot(commands.moves(last)[0], commands.moves(last)[1]));
  const Motion went = followed.path, off{moved.ahead - went.ahead, moved.aside - went.aside};
  Motion apart{0.0, 0.0};
  double hidden = followed.doubt;
  if (law.arc > 0.0) {
    const Motion swift = command_history::at_once(commands, note.time, time);
    apart = {swift.ahead - went.ahead, swift.aside - went.aside};
    hidden += apart.length() + law.lasting * passed;
  }
  const double strayed = strays(note.sums, law, off, apart, followed, passed, noise);
  note.worst = std::max(strayed, differs(note.sums, law, off, went, passed, hidden * speed, noise));
  return note.worst > 1.0;
}

// Compares a sample with the one before, and returns RESPONSE, MOTION or NONE. `pose` (3,): of the point
// that follows; `velocity` (2,): of it in the world; `time`: of both.
inline Index observe(Notes& note, const Law& law, const double* pose, const double* velocity, double time) {
  const double passed = time - note.time;
  if (note.begun && -PAUSE < passed && passed <= 0.0) return reason::NONE;
  const bool continues = note.begun == 1 && 0.0 < passed && passed <= PAUSE;
  double at[3] = {pose[0], pose[1], pose[2]}, noise = 0.0;
  bool drifted = false;
  if (law.regular > 0.0) {
    const double body[4] = {pose[0], pose[1], velocity[0], velocity[1]};
    drifted = drifts(note, law, body, passed, continues);
    std::copy_n(note.position.average, 2, at);
    noise = ALLOWED_AVERAGED * note.position.deviation;
  }
  const bool differs = differs_from_commands(note, law, at, velocity, time, noise, continues);
  note.time = time, note.begun = 1;
  return differs ? reason::RESPONSE : drifted ? reason::MOTION : reason::NONE;
}

// Propagates a robot by its commands, as `command_history` does, and returns what its position may be off
// then [m]: what the alarm lets pass of the motion since.
inline double propagate(Notes& note, const Law& law, double ahead, double* pose, double* twist, double since,
                        double now) {
  const auto moved = command_history::propagate(note.commands, law.response, ahead, pose, twist, since, now);
  return bound(law, now - since, moved.length) + moved.doubt;
}

}  // namespace hcbf::motion_monitor
