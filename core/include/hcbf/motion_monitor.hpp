// Does the pose move as the twist says? Samples are compared at their own times; `monitor` has the law.
// Where samples are missing, the position differs by u_max T²/4 at most.
//
// Positions may be noisy. With e = Δp − T (v + v')/2, white noise of the variance σ² correlates two
// successive e by −σ², and neither a drift nor a scale does. The mean of −e·e'/2 over SAMPLES samples,
// from NOISE² on, is the σ² that the bound allows for. Positions are averaged with what velocities lead
// to, over the time AVERAGED σ.
#pragma once
#include <hcbf/monitor.hpp>

namespace hcbf::motion_monitor {

constexpr double NOISE = 0.02, NOISIEST = 0.03;  // σ before any is known, and the greatest allowed for [m]
constexpr double SAMPLES = 100.0;                // over which it is averaged
constexpr double ALLOWED = 5.0;                  // standard deviations of a position in a bound
constexpr double AVERAGED = 40.0;                // time of averages for each metre of σ [s/m]
constexpr double ELSEWHERE = 0.2;                // from the average, beyond which it starts anew [m]
constexpr double LONGEST = 0.5;                  // between two samples, after which all starts anew [s]

struct Notes {
  monitor::Memory watched;
  monitor::PlanarMemory planar;
  double time;      // [s]
  Index begun;
  double missing;   // [m]
  double apart[2];  // e [m]
  double noise;     // NOISE² − σ² [m²]
  double place[2];  // the position, averaged [m]
  double left;      // σ of it [m]
};

// Lets the average go on to a sample (4,), and returns σ of positions [m].
inline double average(Notes& note, const double* body, double passed) {
  const double *last = note.planar.body, known = NOISE * NOISE;
  const double e_x = body[0] - last[0] - 0.5 * passed * (body[2] + last[2]);
  const double e_y = body[1] - last[1] - 0.5 * passed * (body[3] + last[3]);
  const double seen = -0.5 * (e_x * note.apart[0] + e_y * note.apart[1]);
  double variance = known - note.noise;
  variance += (seen - variance) / SAMPLES;
  variance = std::min(std::max(variance, 0.0), NOISIEST * NOISIEST);
  note.noise = known - variance, note.apart[0] = e_x, note.apart[1] = e_y;
  const double deviation = std::sqrt(variance), left = note.left * note.left;
  double share = passed / (passed + AVERAGED * deviation);
  share = std::max(share, left / std::max(left + variance, 1e-12));  // the mean of the first few
  note.place[0] += body[0] - last[0] - e_x;
  note.place[1] += body[1] - last[1] - e_y;
  const double x = body[0] - note.place[0], y = body[1] - note.place[1];
  if (x * x + y * y > ELSEWHERE * ELSEWHERE) share = 1.0;
  note.place[0] += share * x;
  note.place[1] += share * y;
  note.left = std::sqrt((1.0 - share) * (1.0 - share) * left + share * share * variance);
  return deviation;
}

// Compares a sample (4,) with the one before, and returns whether that alarms. `longest`: a regular time
// between two [s]; `hardest`: the greatest acceleration [m/s²].
inline bool observe(Notes& note, const double* body, double time, double longest, double hardest) {
  const double passed = time - note.time;
  if (note.begun && -LONGEST < passed && passed <= 0.0) return false;
  bool alarms = false;
  if (note.begun == 1 && 0.0 < passed && passed <= LONGEST) {
    const double missed = passed > longest ? 0.25 * hardest * (passed * passed) : 0.0;
    note.missing = monitor::fade(passed) * note.missing + missed;
    const double besides = note.missing + ALLOWED * average(note, body, passed);
    alarms = monitor::drifts(note.watched, note.planar, body, passed, besides, false);
  } else {
    std::fill_n(note.planar.drift, 2, 0.0), std::fill_n(note.planar.motion, 2, 0.0);
    std::fill_n(note.apart, 2, 0.0);
    note.watched.bend = note.watched.in_a_row = note.missing = 0.0;
    note.left = std::sqrt(NOISE * NOISE - note.noise);
    note.place[0] = body[0], note.place[1] = body[1];
  }
  monitor::note_body(note.planar, body);
  note.time = time, note.begun = 1;
  return alarms;
}

}  // namespace hcbf::motion_monitor
