// Dynamic window approach (Fox, Burgard, Thrun 1997): the best of a grid of arcs that the robot can reach now.
#pragma once

#include <memory>

#include "control/controller.hpp"

namespace adrl {

struct DwaConfig {
    double lookahead = 1.0;       // of the target along the path, metres
    double horizon_s = 1.5;       // how far ahead an arc is followed; farther by a robot that needs longer to stop
    double margin_m = 0.03;       // an arc that comes nearer than this to an obstacle hits it
    double comfort_m = 0.15;      // clearance below which an arc costs more
    double comfort_weight = 0.05; // cost, in metres to the target, of touching
    double heading_weight = 0.02; // cost, in metres to the target, of one radian off it at the end
    double hit_weight = 1.0;      // cost, in metres to the target, of a hit right now that braking would avoid
};

// The command that brings the robot nearest to a visible point of the path on average over the horizon. The footprint
// and what is known of the obstacles count exactly, moving discs where they will be.
std::unique_ptr<LocalController> make_dwa(const DwaConfig &config);

} // namespace adrl
