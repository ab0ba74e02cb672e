// The point of a known path that a robot heads for.
#pragma once

#include <algorithm>
#include <array>

#include "planning/path.hpp"
#include "world/world.hpp"

namespace adrl {

struct GuideRules {
    double lookahead = 1.5; // of the waypoint, metres along the path; 0 takes the path's end
    double window = 3.0;    // the robot is looked for so far ahead of where it was on the path
    double corridor = 0.2;  // radius of the disc that must fit through on the straight line to the waypoint
    bool car = false;       // that follows its path from cusp to cusp
};

// Points of the path ahead that a policy may be told, metres along it from where the robot is.
inline constexpr std::array kPathAhead{0.3, 0.6, 1.0, 1.5, 2.2, 3.0};

struct Guided {
    double along = 0.0; // arc length of the path's point nearest to the robot
    double left = 0.0;  // metres to that point and from there along the path
    Vec2 waypoint;
};

// Where on a path robots are. A car has a path of arcs and lines on which it turns back at cusps, and is led to no
// point beyond the next one before it has come there.
//
// The arc length up to which a robot that has come so far is led: the path's end, for a car the next cusp.
double led_to(const Path &path, double along, bool car);
// The arc length of the path's point nearest to p, looked for up to `window` beyond `along`, where the robot was
// before. A car that has nearly come to a cusp has come to it.
double come_along(const Path &path, Vec2 p, double along, double window, bool car);

// Writes the kPathAhead ahead of `along` into out (kPathAhead, 2); those beyond the path's end lie there.
void path_ahead(const Path &path, double along, double *out);

// A robot at p, which was at arc length `along` before.
Guided follow_path(const World &world, const Path &path, const GuideRules &rules, Vec2 p, double along);

// The farthest of some points up to `lookahead` ahead, and not beyond `stop`, that the robot can go to in a straight
// line: a local planner cannot get stuck on the way to it. is_free(point): whether the line from the robot to it is.
template <class Free>
Vec2 visible_waypoint(const Path &path, double along, double stop, double lookahead, const Free &is_free) {
    for (const double part : {1.0, 0.75, 0.55, 0.4, 0.3, 0.2}) {
        const Vec2 target = path.at(std::min(along + part * lookahead, stop));
        if (is_free(target)) return target;
    }
    return path.at(std::min(along + 0.15 * lookahead, stop));
}

} // namespace adrl
