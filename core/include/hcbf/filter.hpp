// The filter of one planar double integrator, x = (p, v), whose acceleration u is held for one period, by
// lex-cbf-qp. It owns the records of `step::filter`; Python binds those of N plants to the same functions.
#pragma once
#include <hcbf/step.hpp>

namespace hcbf::filter {

using class_k::ClassK, polygon::Point, program_records::Lock, program_records::Lower;
struct Filter {
  plants::Constants constants{};
  std::vector<Index> kind, priority;
  std::vector<double> parameters, own_margin, program;  // which has the corners of U, and weights behind them
  struct { plants::Plant plant; double input[2], stop[2]; } sensed{};
  struct { report::Plant plant; Point u_nominal, u_safe; } reported{};
  std::vector<report::Row> rows;  // the report of each condition
  step::Room room;
  Index samples = 0;

  // `corners`: of U around 0, counter-clockwise [m/s²]; `period`: T [s]. α₁ is not scaled to U's braking.
  Filter(std::vector<Point> corners, double period, ClassK alpha1 = {class_k::LOG, 1.0, 0.5, 0.1}) {
    constants.lower = Lower::RELAXED, constants.by_level = true, constants.lock = Lock::BOUND;
    constants.ranks = constants.observed = true, constants.lambda_u = 1.0, constants.period = period;
    constants.corners = corners.size(), constants.weights = 2;
    const ClassK alpha2{class_k::LINEAR, class_k::gain_at(period), 0.0, 0.0};
    RowSettings& made = constants.rows = {alpha1, alpha2, alpha2, period, 0.0, 1.0, {INF, INF}, {-INF, -INF}};
    for (const Point u : corners) {
      constants.radius = made.u_max = std::max(made.u_max, std::hypot(u.x, u.y));
      made.low[0] = std::min(made.low[0], u.x), made.high[0] = std::max(made.high[0], u.x);
      made.low[1] = std::min(made.low[1], u.y), made.high[1] = std::max(made.high[1], u.y);
      program.insert(program.end(), {u.x, u.y});
    }
    program.insert(program.end(), {0.0, INF});  // every rank is decided before the next
  }

  // Adds a condition of a rank, of which 1 is never relaxed: a shape's `write` and its arguments.
  template <class Write, class... Given>
  void add(Index rank, Write write, const Given&... given) {
    parameters.resize(parameters.size() + layout::WIDTH);
    kind.push_back(write(parameters.data() + parameters.size() - layout::WIDTH, given...));
    priority.push_back(rank), own_margin.push_back(0.0), rows.emplace_back();
  }

  // Writes u at the next sample x (4,), unless u* or a rank is refused: `step::Answer`.
  step::Answer operator()(const double* x, Point u_nominal, Point& u) {
    sensed.plant.time = constants.period * samples++, sensed.plant.elapsed = constants.period;
    std::copy_n(x, 4, sensed.plant.x), reported.u_nominal = u_nominal;
    const Index m = kind.size();
    const plants::Plants one{
        {kind.data(), 1, m}, {parameters.data(), 1, m, layout::WIDTH}, {priority.data(), 1, m},
        {own_margin.data(), 1, m}, {nullptr, 0, 0, 0}, {reinterpret_cast<char*>(&sensed), 1, sizeof sensed},
        {reinterpret_cast<char*>(&reported), 1, sizeof reported}, {rows.data(), 1, m}, 2};
    if (const step::Answer wrong = step::check(constants, one)) return wrong;
    const auto settings = step::program_of(constants, {program.data(), Index(program.size())}, 0);
    const bool asks = step::filter(constants, settings, step::plant_of(one, 0), {nullptr, 0}, room);
    u = reported.u_safe;
    return asks ? step::ASKS : step::DONE;
  }
};

}  // namespace hcbf::filter
