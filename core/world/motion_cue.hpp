// What moves around a robot: two scans compared in one frame, the robot's own motion taken out.
#pragma once

#include <vector>

#include "world/geometry.hpp"

namespace adrl {

// A fan of beams angle_min + i * increment about the sensor's pose on the robot, and what is told of it.
struct CueConfig {
    int num_beams = 1;
    double angle_min = 0.0;
    double increment = 0.0;
    Pose mount;
    double max_range = 6.0;
    int num_sectors = 36; // of a full circle, from straight back counter-clockwise
    double margin = 0.05; // metres: smaller changes are noise
    double scale = 0.3;   // metres that count as 1
};

// A point now seen where the past scan saw free space has come; a point seen in the past where the present scan sees
// free space has gone; of what an obstacle hid neither is said. Free is what three beams in a row have passed: a beam
// that slips past an edge tells nothing of its neighbours.
class MotionCue {
  public:
    // At most 2048 beams and sectors.
    explicit MotionCue(const CueConfig &config);

    int num_beams() const { return config_.num_beams; }
    int num_sectors() const { return config_.num_sectors; }
    // ranges, past_ranges (num_beams) and the robot's poses at both -> out (num_sectors): metres of free space that
    // were taken, over scale, negative, or else metres that were set free, positive; within [-1, 1].
    void compute(const float *ranges, const Pose &pose, const float *past_ranges, const Pose &past_pose,
                 float *out) const;

  private:
    float free_beyond(const float *ranges, double beam, double distance) const;
    void mark(double beam, float metres, float *sectors) const;

    CueConfig config_;
    bool full_circle_;
    std::vector<double> dx_, dy_; // beams' directions in the sensor's frame
};

} // namespace adrl
