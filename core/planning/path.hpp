// A route to follow: where along it the robot is, and the point to head for.
#pragma once

#include <span>
#include <vector>

#include "world/geometry.hpp"

namespace adrl {

class Path {
  public:
    Path() = default;
    // Corner points x0, y0, x1, y1, ...; at least one.
    explicit Path(std::span<const double> points) { assign(points); }
    void reserve(int points);
    // Other points; allocates nothing for as many as are reserved.
    void assign(std::span<const double> points);

    const std::vector<Vec2> &points() const { return points_; }
    double length() const { return along_.back(); }
    // Point at arc length s, clamped to the ends.
    Vec2 at(double s) const;
    // Arc length of the point nearest to p among those in [from, to].
    double project(Vec2 p, double from, double to) const;
    // Arc length of the first corner beyond s at which the path turns by more than a right angle; the length where
    // there is none.
    double next_cusp(double s) const;

  private:
    std::vector<Vec2> points_;
    std::vector<double> along_; // arc length at each point
    std::vector<double> cusps_;
};

} // namespace adrl
