// The point of a route to head for, eqs 21 and 23.
#pragma once

#include <algorithm>
#include <vector>

#include "planning/astar.hpp"
#include "planning/occupancy.hpp"
#include "planning/route_planner.hpp"
#include "world/geometry.hpp"

namespace adrl {

struct WaypointRules {
    double min_interval = 0.3; // metres along the route to the nearest candidate
    double max_distance = 1.5; // and to the farthest
    double corridor = 0.25;    // clearance asked for on the straight line to it, metres
    bool literal = false;      // eqs 21 and 23 as printed
};

struct Waypoint {
    Vec2 point;
    double route; // metres of route, pulled taut, from the robot to where it ends
};

inline Vec2 centre_of(Cell c, const WindowShape &shape, const WindowOrigin &origin) {
    return {(static_cast<double>(origin.column + c.column) + 0.5) * shape.resolution,
            (static_cast<double>(origin.row + c.row) + 0.5) * shape.resolution};
}

// Walks the planner's last route from corner to corner, each the farthest cell seen from the last; every second cell is
// tried. visit(a, b): of two corners' numbers along the route.
template <class Visit>
void walk_taut(const RoutePlanner &planner, const std::vector<Cell> &cells, const Visit &visit) {
    const auto is_free = [&](int row, int column) { return planner.is_free(row, column); };
    const auto point = [&](std::size_t k) { return GridPoint{1.0 * cells[k].row, 1.0 * cells[k].column}; };
    const std::size_t last = cells.size() - 1;
    std::size_t corner = 0;
    std::size_t seen = 0;
    while (seen < last) {
        const std::size_t next = std::min(last, seen + 2);
        if (next > corner + 2 && !straight_free(is_free, point(corner), point(next))) {
            visit(corner, seen);
            corner = seen;
        }
        seen = next;
    }
    visit(corner, last);
}

// A point of the planner's last route, made on this window, for a robot on its way to `goal`.
//
// Screening: along the route within [min_interval, max_distance], and a free straight line to it.
// Corrected choice: least of cost from the candidate to the end of the route plus the integral over the straight line
// to it of 1 + weight (k_obstacle O + k_goal (1 - T_goal) + k_turn rho), rho the turn towards it over pi; among equals
// the farthest. Literal choice: least of the straight distance to the goal plus the sum over the route's cells up to it
// of D = 1 / (1 + k_obstacle O + k_goal T_goal + k_turn rho), rho the route's change of heading in the cell over pi.
// Where no candidate passes, the nearest one is taken.
Waypoint choose_waypoint(const RoutePlanner &planner, const RouteCosts &costs, const WaypointRules &rules,
                         const Route &route, const std::int8_t *log_odds, const WindowShape &shape,
                         const WindowOrigin &origin, const Pose &robot, Vec2 goal);

} // namespace adrl
