// How differential drives and cars move: limits, lag, latency and exact arcs.
#pragma once

#include "world/geometry.hpp"

namespace adrl {

struct DriveLimits {
    double max_speed = 0.6;
    double min_speed = 0.0; // below 0 for a robot that may reverse
    double max_yaw_rate = 1.5;
    double max_acceleration = 2.0;
    double max_yaw_acceleration = 6.0;
    double lag_s = 0.0;              // time constant of the first-order lag
    double min_turning_radius = 0.0; // of a car, metres; 0 for a robot that turns on the spot
    bool is_car() const { return min_turning_radius > 0.0; }
};

// Exact arc: x' = x + v/w (sin(theta + w dt) - sin theta), y likewise with the cosine; a straight line as w -> 0.
Pose integrate(const Pose &pose, const Twist &twist, double dt_s);

// The inverse of advance_twist: the command after which the base executes `wanted` in dt_s, if it can accelerate so.
Twist lead_lag(const Twist &wanted, const Twist &twist, const DriveLimits &limits, double dt_s);

// A twist with no tighter a turn than the robot can steer, |w| R <= |v|: the speed is kept and the yaw rate is held to
// |v| / R.
Twist steerable(const Twist &twist, const DriveLimits &limits);

// A command brought inside the speed limits, and steerable.
Twist clip_command(const Twist &command, const DriveLimits &limits);

// Twist after dt: first-order lag towards the command, its change held to the acceleration limits. What a car cannot
// steer it does not turn: as it brakes, its yaw rate falls with its speed.
Twist advance_twist(const Twist &twist, const Twist &command, const DriveLimits &limits, double dt_s);

// The arc that a base drives while its twist changes from one to the next: their mean, and steerable, which between
// forward and backward the mean of two steerable ones need not be.
Twist mean_twist(const Twist &from, const Twist &to, const DriveLimits &limits);

} // namespace adrl
