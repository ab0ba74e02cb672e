#include "planning/waypoint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace adrl {
namespace {

struct Chooser {
    const RoutePlanner &planner;
    const RouteCosts &costs;
    const WindowShape &shape;
    const WindowOrigin &origin;
    const Pose &robot;
    Vec2 goal;

    Vec2 centre(Cell c) const { return centre_of(c, shape, origin); }

    double obstacle_density(Vec2 p) const {
        const auto row = static_cast<std::int64_t>(std::floor(p.y / shape.resolution)) - origin.row;
        const auto column = static_cast<std::int64_t>(std::floor(p.x / shape.resolution)) - origin.column;
        if (row < 0 || column < 0 || row >= shape.height || column >= shape.width) return 0.0;
        return planner.obstacle_density(static_cast<int>(row), static_cast<int>(column));
    }

    double goal_proximity(Vec2 p) const { return std::clamp(1.0 - norm(goal - p) / costs.near_goal, 0.0, 1.0); }

    // Integral of 1 + weight density over the straight line, midpoints of pieces no longer than half a cell.
    double straight_cost(Vec2 to) const {
        const Vec2 from{robot.x, robot.y};
        const double length = norm(to - from);
        const double turn = wrap_angle(std::atan2(to.y - from.y, to.x - from.x) - robot.theta);
        const int pieces = std::max(1, static_cast<int>(std::ceil(2.0 * length / shape.resolution)));
        double density = 0.0;
        for (int k = 0; k < pieces; ++k) {
            const Vec2 p = from + ((k + 0.5) / pieces) * (to - from);
            density += costs.k_obstacle * obstacle_density(p) + costs.k_goal * (1.0 - goal_proximity(p));
        }
        density = density / pieces + costs.k_turn * std::abs(turn) / std::numbers::pi;
        return length * (1.0 + costs.weight * density);
    }

    // D of eq 21 as printed.
    double literal_density(const std::vector<Cell> &cells, std::size_t k) const {
        const Vec2 p = centre(cells[k]);
        double turn = 0.0;
        if (k + 1 < cells.size()) {
            const Vec2 came = p - centre(cells[k - 1]);
            const Vec2 leaves = centre(cells[k + 1]) - p;
            turn = std::abs(std::atan2(cross(came, leaves), dot(came, leaves)));
        }
        return 1.0 / (1.0 + costs.k_obstacle * planner.obstacle_density(cells[k].row, cells[k].column) +
                      costs.k_goal * goal_proximity(p) + costs.k_turn * turn / std::numbers::pi);
    }
};

} // namespace

Waypoint choose_waypoint(const RoutePlanner &planner, const RouteCosts &costs, const WaypointRules &rules,
                         const Route &route, const std::int8_t *log_odds, const WindowShape &shape,
                         const WindowOrigin &origin, const Pose &robot, Vec2 goal) {
    const std::vector<Cell> &cells = *route.cells;
    const Chooser chooser{planner, costs, shape, origin, robot, goal};
    const Vec2 from{robot.x, robot.y};
    const std::size_t last = cells.size() - 1;
    const auto place = [&](std::size_t k) { return k == last && route.reached ? goal : chooser.centre(cells[k]); };
    double length = 0.0;
    walk_taut(planner, cells, [&](std::size_t a, std::size_t b) {
        length += norm(chooser.centre(cells[b]) - chooser.centre(cells[a]));
    });
    Waypoint best{place(last), length};
    double least = std::numeric_limits<double>::infinity();
    double along = 0.0;
    double sum = 0.0;
    bool fallback = false;
    for (std::size_t k = 1; k <= last && along <= rules.max_distance; ++k) {
        along += norm(chooser.centre(cells[k]) - chooser.centre(cells[k - 1]));
        if (rules.literal) sum += chooser.literal_density(cells, k);
        if (along > rules.max_distance || (along < rules.min_interval && k < last)) continue;
        const Vec2 point = place(k);
        if (!fallback) best.point = point;
        fallback = true;
        if (!corridor_seen_free(log_odds, shape, origin, from, point, rules.corridor)) continue;
        const double score =
            rules.literal ? norm(goal - point) + sum : planner.cost_to_go()[k] + chooser.straight_cost(point);
        if (score > least + 1e-9) continue;
        least = std::min(score, least);
        best.point = point;
    }
    return best;
}

} // namespace adrl
