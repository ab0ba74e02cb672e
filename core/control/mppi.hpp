// Model predictive path integral control (Williams et al. 2017) with critics as in Nav2's MPPI controller: many noisy
// control sequences are rolled out, and the next mean is their average, weighted by exp(-cost / temperature).
#pragma once

#include <memory>
#include <vector>

#include "control/controller.hpp"

namespace adrl {

inline constexpr int kMaxMppiBatch = 1024;
inline constexpr int kMaxMppiSteps = 64;

// Names and units of cost are Nav2's where it has them. Standard deviations are shares of the robot's own limits.
struct MppiConfig {
    int batch_size = 500;
    int time_steps = 20;
    double model_dt = 0.1;          // s a step; the control period where that is longer
    double temperature = 0.1;       // the higher, the more samples count
    double gamma = 0.015;           // weight of the difference from the mean
    double vx_std = 0.3;            // noise, of the greatest speed
    double wz_std = 0.5;            // and of the greatest yaw rate
    double noise_correlation = 0.9; // of one step's noise with the next one's; 0 is Nav2's white noise
    double collision_cost = 10000.0;
    double collision_margin_m = 0.05;   // a footprint that comes nearer than this collides
    double inflation_m = 0.3;           // clearance below which an obstacle repels,
    double repulsion_weight = 1.5;      // at contact so much, mean over the steps
    double path_align_weight = 5.0;     // a metre off the path's point of equal length, mean over the steps
    double path_follow_weight = 10.0;   // a metre from the last pose to a point beyond those that samples reach,
    double path_follow_offset_m = 0.5;  // by this
    double path_angle_weight = 2.0;     // the last pose 90 degrees off that point,
    double max_angle_to_furthest = 1.0; // where the robot itself is further off than this, rad
    double goal_weight = 5.0;           // a metre from the goal, mean over the steps,
    double goal_threshold_m = 1.4;      // within this of it; the path's critics rest there
    double prefer_forward_weight = 5.0; // a metre driven backward
};

// Noise of the samples in units of its standard deviations, (time_steps, 2, batch_size): speeds, then yaw rates.
// Samples 2 k and 2 k + 1 have the same speeds and opposite yaw rates.
std::vector<float> mppi_noise(const MppiConfig &config);

// Numbers that it remembers of a robot: the mean, a speed and a yaw rate a step.
int mppi_memory(const MppiConfig &config);

// The rollouts know limits, accelerations and lag of the base, and moving discs where they will be.
std::unique_ptr<LocalController> make_mppi(const MppiConfig &config, const Footprint &footprint,
                                           const DriveLimits &limits, double dt_s);

} // namespace adrl
