#include "drive/kinematics.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {

Pose integrate(const Pose &pose, const Twist &twist, double dt_s) {
    // The chord of the arc: v dt sinc(w dt / 2) long, at heading theta + w dt / 2. No division by a small w.
    const double half = 0.5 * twist.w * dt_s;
    const double sinc = std::abs(half) < 1e-4 ? 1.0 - half * half / 6.0 : std::sin(half) / half;
    const double chord = twist.v * dt_s * sinc;
    return {pose.x + chord * std::cos(pose.theta + half), pose.y + chord * std::sin(pose.theta + half),
            wrap_angle(pose.theta + twist.w * dt_s)};
}

Twist steerable(const Twist &twist, const DriveLimits &limits) {
    if (!limits.is_car()) return twist;
    const double most = std::abs(twist.v) / limits.min_turning_radius;
    return {twist.v, std::clamp(twist.w, -most, most)};
}

Twist clip_command(const Twist &command, const DriveLimits &limits) {
    return steerable({std::clamp(command.v, limits.min_speed, limits.max_speed),
                      std::clamp(command.w, -limits.max_yaw_rate, limits.max_yaw_rate)},
                     limits);
}

namespace {

double approach(double value, double command, double response, double largest_change) {
    const double next = value + std::clamp(response * (command - value), -largest_change, largest_change);
    // A lag never quite arrives; without this a robot at rest would compute in denormals for ever.
    return std::abs(command - next) < 1e-12 ? command : next;
}

// Share of the way to a command that a lag lets the base come in dt_s.
double response_of(const DriveLimits &limits, double dt_s) {
    return limits.lag_s > 0.0 ? -std::expm1(-dt_s / limits.lag_s) : 1.0;
}

} // namespace

Twist advance_twist(const Twist &twist, const Twist &command, const DriveLimits &limits, double dt_s) {
    const double response = response_of(limits, dt_s);
    return steerable({approach(twist.v, command.v, response, limits.max_acceleration * dt_s),
                      approach(twist.w, command.w, response, limits.max_yaw_acceleration * dt_s)},
                     limits);
}

Twist mean_twist(const Twist &from, const Twist &to, const DriveLimits &limits) {
    return steerable({0.5 * (from.v + to.v), 0.5 * (from.w + to.w)}, limits);
}

Twist lead_lag(const Twist &wanted, const Twist &twist, const DriveLimits &limits, double dt_s) {
    const double response = response_of(limits, dt_s);
    return {twist.v + (wanted.v - twist.v) / response, twist.w + (wanted.w - twist.w) / response};
}

} // namespace adrl
