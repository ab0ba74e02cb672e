// How near the footprint itself comes to obstacles at many of MPPI's poses at once: those at which its circumscribed
// disc is too near to tell.
#pragma once

#include <vector>

#include "control/mppi.hpp"
#include "control/obstacle_field.hpp"
#include "drive/footprint_balls.hpp"

namespace adrl {

struct SeenDiscs { // moving discs at one instant, in the robot's frame
    float x[kMaxDiscs], y[kMaxDiscs], radius[kMaxDiscs];
    int count = 0;
};

class MppiFootprint {
  public:
    // margin: by which clearances may be too great.
    MppiFootprint(const Footprint &footprint, double margin);

    float inscribed() const { return inscribed_; } // radius of the greatest ball in the footprint

    void begin() { lanes_.count = 0; }
    // A sample's pose, in the robot's frame; (hx, hy) is its heading.
    void add(int sample, float x, float y, float hx, float hy);
    // The clearances of the samples added since begin(), up to `most`, each into its place of `clear`.
    void measure(const ObstacleField &field, const SeenDiscs &discs, float most, float *clear);

    struct Lanes {
        alignas(64) float x[kMaxMppiBatch], y[kMaxMppiBatch], hx[kMaxMppiBatch], hy[kMaxMppiBatch];
        alignas(64) float clear[kMaxMppiBatch];
        alignas(64) float ball_x[kMaxMppiBatch], ball_y[kMaxMppiBatch], distance[kMaxMppiBatch];
        int sample[kMaxMppiBatch];
        int count = 0;
    };

  private:
    Lanes lanes_;
    std::vector<Ball> balls_;
    float inscribed_ = 0.0F;
};

} // namespace adrl
