// How badly two scans fit each other under a motion between them.
#pragma once

#include <span>
#include <vector>

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

// One scan laid over another.
class Overlay {
  public:
    // Of `seen` every `stride`th beam is taken. A point counts by its distance from the surface as a share of `scale`.
    Overlay(const Fan &seen, const Fan &surface, double scale, int stride);

    // What `seen` hit, moved by `motion` (the pose of its sensor in the frame of the other's), against the surface that
    // `surface` has hit: the line through two neighbouring hits, or the nearer one where they are of two things. Each
    // point counts at most 1, as it does where the surface's beams have passed it. What only one of the two tells of
    // is left out.
    Misfit misfit(const Pose &motion) const;

  private:
    double distance(Vec2 p) const;

    Fan surface_;
    double scale_;
    double turn_; // beams of the surface to a full circle
    std::vector<Vec2> seen_, hits_;
};

} // namespace adrl
