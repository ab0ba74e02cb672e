// Optimal reciprocal collision avoidance as a robot's own controller, as in the papers of CrowdNav: it is told the true
// velocities of all that moves, which no robot measures, and walks as people do (world/avoidance.hpp).
#pragma once

#include <memory>

#include "control/controller.hpp"

namespace adrl {

struct OrcaConfig {
    double lookahead = 1.0;      // of the point of the path that is preferred, metres
    double share = 0.5;          // of avoiding what moves, which is taken to do the rest; what stands is avoided alone
    double horizon_s = 3.0;      // for which what moves is avoided,
    double wall_horizon_s = 1.0; // and walls
    double space_m = 0.1;        // left about the robot's circumscribed disc
    double turn_s = 0.3;         // in which it would turn to a velocity that does not lie ahead
};

// The velocity becomes a twist of a robot that turns on the spot: it turns towards it, and drives the part of it that
// lies ahead. In a known world alone.
std::unique_ptr<LocalController> make_orca(const OrcaConfig &config);

} // namespace adrl
