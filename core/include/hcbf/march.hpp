// The geodesic field on a grid: the cost of the cheapest path from every cell to the goal.
//
// The field T solves the eikonal equation |grad T| = c, T(goal) = 0, by upwind differences,
//
//     sum over axes of max(0, T - T_axis)^2 = (c side)^2,     T_axis the lower neighbour's on that axis.
//
// Cells settle in stages: first the open ones and those of ranks that may be crossed at their price; then,
// of all that is left, the lowest rank, and so on up to rank 1. A stage begins at a toll above all that is
// settled. So no closed rank is on a path where one without it exists, however long that is, and from
// within a closed region the field leads out, through strict cells only where nothing else is left.
//
// Cells wait in buckets of equal T, and one whose T falls waits again: the order is a matter of speed alone.
//
// Source: J. A. Sethian, A fast marching level set method for monotonically advancing fronts, PNAS 93, 1996;
// L. Yatziv, A. Bartesaghi, G. Sapiro, O(N) implementation of the fast marching algorithm, Journal of
// Computational Physics 212, 2006.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include <hcbf/arrays.hpp>

namespace hcbf::march {

using Rank = std::int8_t;
using Number = std::int32_t;  // of a cell

constexpr Index BUCKETS = 1 << 15;  // lists of waiting cells, in a ring
constexpr Index RING = BUCKETS - 1;
constexpr double APART = 4.0;  // a stage begins so many times above what is settled
constexpr Number NOWHERE = -1;
constexpr double INF = std::numeric_limits<double>::infinity();

// A grid's cells in one row each, with a border that is never entered.
struct Cells {
  Vector<const float> cost;  // of a step through a cell, infinite on the border
  Vector<const Rank> rank;   // the highest among the regions that a cell is in, 0 in the open
  Index nx;                  // cells of a row
  Vector<float> field;       // T, written to; infinity where it is not known
  Vector<Rank> through;      // through which rank the goal is reached: 0 none, 1 not at all; written to
};

// Cells that wait, in lists of about equal T.
class Queue {
 public:
  explicit Queue(Index cells) : first_(BUCKETS, NOWHERE), after_(cells), before_(cells), waiting_(cells, 0) {}

  Number first(Index bucket) const { return first_[bucket]; }
  Number after(Number cell) const { return after_[cell]; }
  bool waits(Index cell) const { return waiting_[cell]; }

  // Takes a cell out of its list.
  void take(Index cell) {
    const Number before = before_[cell], after = after_[cell];
    (before < NOWHERE ? first_[-2 - before] : after_[before]) = after;
    if (after != NOWHERE) before_[after] = before;
    waiting_[cell] = 0;
  }

  // Puts a cell into a list, out of the one that it may be in.
  void put(Index cell, Index bucket) {
    if (waits(cell)) take(cell);
    const Number head = first_[bucket];
    first_[bucket] = static_cast<Number>(cell);
    after_[cell] = head;
    before_[cell] = static_cast<Number>(-2 - bucket);
    if (head != NOWHERE) before_[head] = static_cast<Number>(cell);
    waiting_[cell] = 1;
  }

 private:
  std::vector<Number> first_, after_;
  std::vector<Number> before_;  // -2 - list for the first of a list
  std::vector<char> waiting_;
};

// Returns whether a cell of this rank may be entered: ranks from `level` on may, for 0 none.
inline bool is_open(Index rank, Index level) { return rank == 0 || (level > 0 && rank >= level); }

// The higher of two ranks, 0 where both are none.
inline Rank worst(Rank rank, Rank other) {
  return rank == 0 || other == 0 ? std::max(rank, other) : std::min(rank, other);
}

// T of a cell, and the neighbour that it comes from.
struct Arrival {
  double t;
  Index source;
};

// Which cells a stage settles.
struct Stage {
  Index level;  // ranks from it on may be entered, 0 for none
  double toll;  // what settled in the stages before, up to this T, pays so much

  // Out of rank 1 all paths are alike: the shortest is the one, however dear it is from there on.
  double tolled(double t) const { return t <= toll ? toll + t * (level != 1) : t; }

  // The lower T of two neighbours.
  Arrival lower(Vector<float> field, Index one, Index other) const {
    const double t = tolled(field[one]), u = tolled(field[other]);
    return t <= u ? Arrival{t, one} : Arrival{u, other};
  }

  // T by the upwind equation.
  Arrival arrive(Vector<float> field, Index nx, double step, Index cell) const {
    const Arrival x = lower(field, cell - 1, cell + 1), y = lower(field, cell - nx, cell + nx);
    const Arrival& least = x.t - y.t < 0.0 ? x : y;
    const double apart = std::abs(x.t - y.t);
    // or the other axis says nothing, or both are infinite
    if (!(apart < step)) return {least.t + step, least.source};
    return {0.5 * (x.t + y.t + std::sqrt(2.0 * step * step - apart * apart)), least.source};
  }
};

// Returns through which rank the goal is reached from a cell over a neighbour.
//
// A robot that presses against a strict edge is within its clearance, and often in a cell of rank 1. Its
// own cell does not count; a path *into* rank 1 is none.
inline Rank reached(Vector<const Rank> rank, Vector<Rank> through, Index cell, Index source) {
  if (rank[cell] == 1) return through[source];
  if (rank[source] == 1) return 1;
  return worst(rank[cell], through[source]);
}

struct Begun {
  Index waiting;  // how many cells
  double width;   // T of a bucket
};

// Puts into the queue what a stage can settle from what is settled.
//
// A bucket is as wide as the cheapest step, so that about equal T wait together.
inline Begun begin(const Cells& cells, const Stage& stage, Queue& queue) {
  struct Found {
    Index cell;
    float t;
    Index source;
  };
  const auto [cost, rank, nx, field, through] = cells;
  std::vector<Found> found;
  double lowest = INF, highest = 0.0, cheapest = INF, dearest = 0.0;
  for (Index cell = nx + 1; cell < field.size - nx - 1; ++cell) {
    const float here = field[cell];
    if (here <= stage.toll || !(cost[cell] < INF) || !is_open(rank[cell], stage.level)) continue;
    const double step = cost[cell];
    cheapest = std::min(cheapest, step), dearest = std::max(dearest, step);
    const auto [t, source] = stage.arrive(field, nx, step, cell);
    if (static_cast<float>(t) < here) {
      lowest = std::min(lowest, t), highest = std::max(highest, t);
      found.push_back({cell, static_cast<float>(t), source});
    }
  }
  const double width = std::max(cheapest, (highest - lowest + 2.0 * dearest) / (BUCKETS - 2));
  for (const auto& [cell, t, source] : found) {
    through[cell] = reached(rank, through, cell, source);
    field[cell] = t;
    queue.put(cell, static_cast<Index>(t / width) & RING);
  }
  return {static_cast<Index>(found.size()), width};
}

// Settles what waits and all that follows from it; returns the highest T among it.
inline double relax(const Cells& cells, const Stage& stage, Begun begun, Queue& queue) {
  const auto [cost, rank, nx, field, through] = cells;
  auto [waiting, width] = begun;
  double highest = 0.0, lowest = INF;
  for (Index bucket = 0; bucket < BUCKETS; ++bucket)
    for (Number cell = queue.first(bucket); cell != NOWHERE; cell = queue.after(cell))
      lowest = std::min<double>(lowest, field[cell]);
  Index turn = waiting > 0 ? static_cast<Index>(lowest / width) : 0;
  while (waiting > 0) {
    const Number cell = queue.first(turn & RING);
    if (cell == NOWHERE) {
      ++turn;
      continue;
    }
    queue.take(cell);
    --waiting;
    const float here = field[cell];
    highest = std::max<double>(highest, here);
    for (const Index side : {Index{-1}, Index{1}, -nx, nx}) {
      const Index near = cell + side;
      if (field[near] <= here || !(cost[near] < INF) || !is_open(rank[near], stage.level))
        continue;  // on the border: what is behind it is no cell
      const auto [t, source] = stage.arrive(field, nx, cost[near], near);
      if (static_cast<float>(t) < field[near]) {
        field[near] = static_cast<float>(t);
        through[near] = reached(rank, through, near, source);
        waiting += !queue.waits(near);
        queue.put(near, std::max(turn, static_cast<Index>(field[near] / width)) & RING);
      }
    }
  }
  return highest;
}

// The levels of all stages, as `is_open` takes them: what is open first, rank 1 last.
//
// opened: ranks from it on may be crossed at their price, above 1; 0 for none.
inline std::vector<Index> levels(Vector<const Rank> rank, Index opened) {
  std::array<bool, 128> there{};
  for (Index cell = 0; cell < rank.size; ++cell) there[rank[cell]] = true;
  std::vector<Index> found{static_cast<Rank>(opened)};
  for (Index level = 127; level > 0; --level)
    if (there[level] && !is_open(level, opened)) found.push_back(level);
  return found;
}

// Writes T and `through` of a whole grid, of cells with that side [m], around the goal's cell.
inline void march(const Cells& cells, double side, Index opened, Index goal) {
  Queue queue(cells.field.size);
  std::fill_n(cells.field.data, cells.field.size, std::numeric_limits<float>::infinity());
  std::fill_n(cells.through.data, cells.through.size, Rank{0});
  cells.field[goal] = 0.0f;
  double highest = 0.0, toll = -1.0;
  for (const Index level : levels(cells.rank, opened)) {
    const Stage stage{level, toll};
    const Begun begun = begin(cells, stage, queue);
    highest = std::max(highest, relax(cells, stage, begun, queue));
    toll = APART * highest + side;
  }
}

}  // namespace hcbf::march
