// Exact ray casting of a planar LiDAR against everything a world holds.
#pragma once

#include <vector>

#include "world/geometry.hpp"
#include "world/moving.hpp"

namespace adrl {

// Directions of a scan's beams in the sensor's frame, padded to kLanes.
class Beams {
  public:
    // Any angles: every obstacle is tested against every beam.
    explicit Beams(const std::vector<double> &angles);
    // angle_min + i * increment: an obstacle is tested only against the beams that can meet it. Anything but a
    // counter-clockwise fan of at most a full turn is cast like any other angles.
    Beams(int count, double angle_min, double increment);

    int count() const { return count_; }
    int padded() const { return static_cast<int>(dx_.size()); }
    const double *dx() const { return dx_.data(); }
    const double *dy() const { return dy_.data(); }
    bool uniform() const { return uniform_; }
    double angle_min() const { return angle_min_; }
    double increment() const { return increment_; }

  private:
    void point(const std::vector<double> &angles);
    int count_ = 0;
    bool uniform_ = false;
    double angle_min_ = 0.0;
    double increment_ = 0.0;
    std::vector<double> dx_, dy_;
};

// Ranges in metres from the sensor's pose to the first obstacle along each beam, at most max_range; 0 everywhere when
// the sensor is inside an obstacle. ranges holds beams.padded() numbers; the padding's values mean nothing.
void raycast(const World &world, const DiscPlaces &discs, const Pose &sensor, const Beams &beams, double max_range,
             double *ranges);

} // namespace adrl
