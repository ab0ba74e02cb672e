// How badly two scans fit each other under a motion between them.
#pragma once

#include <span>

#include "world/geometry.hpp"

namespace adrl {

// A fan of beams angle_min + i * increment: infinity where nothing is within max_range, NaN where a beam tells nothing.
struct Fan {
    std::span<const double> ranges;
    double angle_min = 0.0;
    double increment = 0.0; // below 0 for a scan that runs clockwise
    double max_range = 0.0;
};

struct Misfit {
    double mean = 0.0; // 0 where all fits, 1 where nothing does
    int points = 0;    // that were compared
};

// What `seen` hit, moved by `motion` (the pose of its sensor in the frame of the other's), against the surface that
// `surface` has hit: the line through two neighbouring hits, or the nearer one where they are of two things. Each point
// counts by its distance from there as a share of `scale`, at most 1; 1 too where the surface's beams have passed it.
// What only one of them tells of is left out. Every `stride`th beam is taken.
Misfit misfit(const Fan &seen, const Fan &surface, const Pose &motion, double scale, int stride);

} // namespace adrl
