// What a car drives of a route on its own map: the first metres of it, as curves that it can steer.
#pragma once

#include <vector>

#include "planning/car_planner.hpp"
#include "planning/occupancy.hpp"
#include "planning/path.hpp"
#include "planning/route_planner.hpp"
#include "planning/waypoint.hpp"

namespace adrl {

class CarRoute {
  public:
    explicit CarRoute(const WindowShape &shape);

    // Curves from the robot's pose to a point of the planner's last route, made on this window: its end, or a point
    // kAhead metres along it. Whether there are such; where there are not, to a nearer point of it.
    bool plan(const CarModel &model, const RoutePlanner &planner, const Route &route, const WindowOrigin &origin,
              const Pose &robot, Vec2 goal);

    // Of the last plan that found one: its corners, as CarPlanner has them, and the route's metres beyond them.
    const Path &path() const { return path_; }
    double beyond() const { return beyond_; }
    // The farthest of some points before the first cusp that lie in sight.
    Waypoint waypoint(const WaypointRules &rules, const std::int8_t *log_odds, const WindowOrigin &origin,
                      const Pose &robot) const;

  private:
    WindowShape shape_;
    CarPlanner planner_;
    std::vector<float> clearance_; // (H, W)
    std::vector<double> taut_, points_;
    Path route_, path_;
    double beyond_ = 0.0;
};

} // namespace adrl
