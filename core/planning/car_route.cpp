#include "planning/car_route.hpp"

#include <algorithm>

#include "planning/path_guide.hpp"

namespace adrl {
namespace {

constexpr double kAhead = 6.0; // metres: farther on, the next plan knows more
constexpr int kMostPoses = 1 << 14;

} // namespace

CarRoute::CarRoute(const WindowShape &shape)
    : shape_(shape), planner_(shape.height, shape.width, shape.resolution, kMostPoses),
      clearance_(static_cast<std::size_t>(shape.height) * shape.width) {
    const int cells = shape.height * shape.width;
    taut_.reserve(2L * cells);
    points_.reserve(2L * CarPlanner::kMostCorners);
    route_.reserve(cells);
    path_.reserve(CarPlanner::kMostCorners);
}

bool CarRoute::plan(const CarModel &model, const RoutePlanner &planner, const Route &route, const WindowOrigin &origin,
                    const Pose &robot, Vec2 goal) {
    const std::vector<Cell> &cells = *route.cells;
    taut_.clear();
    const auto add = [&](Vec2 p) {
        taut_.push_back(p.x);
        taut_.push_back(p.y);
    };
    add({robot.x, robot.y});
    if (cells.size() > 1) {
        walk_taut(planner, cells, [&](std::size_t, std::size_t b) {
            add(b + 1 == cells.size() && route.reached ? goal : centre_of(cells[b], shape_, origin));
        });
    } else {
        add(goal);
    }
    route_.assign(taut_);
    planner.clearances(clearance_.data());
    const Vec2 corner{static_cast<double>(origin.column) * shape_.resolution,
                      static_cast<double>(origin.row) * shape_.resolution};
    for (const double ahead : {kAhead, 0.5 * kAhead}) {
        const double to = std::min(ahead, route_.length());
        if (!planner_.plan(model, {clearance_.data(), corner}, robot, route_.at(to))) continue;
        points_.clear();
        for (const Pose &pose : planner_.poses()) {
            points_.push_back(pose.x);
            points_.push_back(pose.y);
        }
        path_.assign(points_);
        beyond_ = route_.length() - to;
        return true;
    }
    return false;
}

Waypoint CarRoute::waypoint(const WaypointRules &rules, const std::int8_t *log_odds, const WindowOrigin &origin,
                            const Pose &robot) const {
    const Vec2 here{robot.x, robot.y};
    const auto in_sight = [&](Vec2 p) { return corridor_seen_free(log_odds, shape_, origin, here, p, rules.corridor); };
    const double stop = led_to(path_, come_along(path_, here, 0.0, 0.0, true), true);
    return {visible_waypoint(path_, 0.0, stop, rules.max_distance, in_sight), path_.length() + beyond_};
}

} // namespace adrl
