// A footprint as a few balls, for planners and controllers that ask for the clearance of very many poses.
#pragma once

#include <vector>

#include "drive/collision.hpp"

namespace adrl {

struct Ball { // in the robot's frame
    float x, y, radius;
};

// Balls inside the footprint that come within `margin` of every point of its rim: their least clearance is never below
// the footprint's, and above it by at most about the margin. Few: each is the one that comes near to most of the rim.
std::vector<Ball> footprint_balls(const Footprint &footprint, double margin);

} // namespace adrl
