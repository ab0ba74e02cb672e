// Regulated pure pursuit (Macenski et al. 2023), as Nav2's controller of that name: an arc to a point of the path, the
// slower the tighter it is and the nearer obstacles are.
#pragma once

#include <memory>

#include "control/controller.hpp"

namespace adrl {

// Names are Nav2's where it has them. Speeds are shares of the robot's own.
struct PursuitConfig {
    double lookahead_time = 0.54;                      // the point lies so far ahead, s at the current speed,
    double min_lookahead_dist = 0.66;                  // but no nearer than this, m,
    double max_lookahead_dist = 2.0;                   // nor farther
    double rotate_to_heading_min_angle = 0.68;         // beyond it the robot turns in place, rad
    double regulated_linear_scaling_min_radius = 0.56; // arcs tighter than this, m, are driven slower
    double regulated_linear_scaling_min_speed = 0.23;  // no regulation asks for less than this share of the speed
    double cost_scaling_dist = 0.073; // obstacles nearer than this, m from the footprint, slow the robot down
    double cost_scaling_gain = 1.0;   // times clearance over that distance is the share of the speed
    double max_allowed_time_to_collision = 0.72; // s ahead that must be free, and always as long as stopping takes
    double margin_m = 0.047;                     // an arc that comes nearer than this to an obstacle hits it
};

// The point is one that the robot sees along a straight line as wide as itself. An arc that hits is driven more slowly,
// at last not at all: then the robot turns in place towards the point where it can.
std::unique_ptr<LocalController> make_pure_pursuit(const PursuitConfig &config);

} // namespace adrl
