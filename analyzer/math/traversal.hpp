#pragma once
// Splits a straight stride over the cells of a square grid (Amanatides & Woo 1987), in order of travel. Cell (i, j)
// covers [i c, (i+1) c) x [j c, (j+1) c): origin-aligned, so that grids of different months can be subtracted.
//
// Law: the parts follow each other without hole or overlap from 0 to 1, so whatever is shared out in proportion
// (to - from) adds up to the whole but for rounding (1e-12 relative). Parts of zero length are left out, except the
// only part of a stride without length.

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>

namespace tacho::math {

struct Point {
  double x = 0.0;
  double y = 0.0;
};
inline double distance(Point a, Point b) { return std::hypot(b.x - a.x, b.y - a.y); }

struct CellIndex {
  std::int64_t i = 0;
  std::int64_t j = 0;
  friend bool operator==(const CellIndex&, const CellIndex&) = default;
};

/// Coordinates must be finite and below 1e15 cells.
inline CellIndex cell_of(Point p, double cell_m) {
  return {static_cast<std::int64_t>(std::floor(p.x / cell_m)), static_cast<std::int64_t>(std::floor(p.y / cell_m))};
}

/// A part of a stride inside one cell; `from` and `to` are fractions of the stride.
struct Part {
  CellIndex cell;
  double from = 0.0;
  double to = 1.0;
};

/// Border crossings of one axis. The number of steps is taken from the end cells, not from accumulated parameters, so
/// that rounding can neither miss the last cell nor run past it.
class AxisWalk {
 public:
  AxisWalk(double a, double b, std::int64_t first, std::int64_t last, double cell_m)
      : a_(a), delta_(b - a), cell_m_(cell_m), at_(first), left_(std::llabs(last - first)), up_(last > first) {}
  [[nodiscard]] std::int64_t at() const { return at_; }
  /// Fraction of the stride at which the next border is crossed; infinite when there is none.
  [[nodiscard]] double next() const {
    if (left_ == 0) {
      return std::numeric_limits<double>::infinity();
    }
    return (static_cast<double>(up_ ? at_ + 1 : at_) * cell_m_ - a_) / delta_;
  }
  void step() {
    at_ += up_ ? 1 : -1;
    --left_;
  }

 private:
  double a_;
  double delta_;
  double cell_m_;
  std::int64_t at_;
  std::int64_t left_;
  bool up_;
};

/// Calls `visit(const Part&)` for each part of the stride from a to b.
template <class Visit>
void traverse(Point a, Point b, double cell_m, Visit&& visit) {
  const CellIndex first = cell_of(a, cell_m);
  const CellIndex last = cell_of(b, cell_m);
  AxisWalk x(a.x, b.x, first.i, last.i, cell_m);
  AxisWalk y(a.y, b.y, first.j, last.j, cell_m);
  double from = 0.0;
  for (;;) {
    const double border = std::fmin(x.next(), y.next());
    const bool end = border == std::numeric_limits<double>::infinity();
    const double to = end ? 1.0 : std::fmin(1.0, std::fmax(from, border));
    if (to > from || (end && from == 0.0)) {
      visit(Part{{x.at(), y.at()}, from, to});
    }
    if (end) {
      return;
    }
    from = to;
    (x.next() <= y.next() ? x : y).step();
  }
}

}  // namespace tacho::math
