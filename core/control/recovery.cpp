#include "control/recovery.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {
namespace {

constexpr double kProgress = 0.3; // metres
constexpr double kPatience = 4.0; // seconds
constexpr double kEscape = 2.0;
constexpr double kSpeed = 0.3; // of the arcs, m/s and rad/s, or the robot's own where that is less
constexpr double kYawRate = 1.0;
constexpr double kLook = 1.0; // seconds that an arc is followed
constexpr int kPoses = 8;
constexpr double kRoom = 0.5; // clearance beyond which all places are alike

Twist escape(const Situation &now) {
    const double forward = std::min(kSpeed, now.limits.max_speed);
    const double backward = std::max(-kSpeed, now.limits.min_speed);
    const double rate = std::min(kYawRate, now.limits.max_yaw_rate);
    Twist best;
    double most = 0.0;
    for (const double w : {0.0, rate, -rate}) {
        for (const double v : {0.0, forward, backward}) {
            // Standing is what it is stuck in, and a car does not turn without driving.
            if (v == 0.0 && (w == 0.0 || now.limits.is_car())) continue;
            const Twist arc = steerable({v, w}, now.limits);
            double room = 0.0;
            double least = kRoom;
            for (int k = 1; k <= kPoses && least > 0.0; ++k) {
                const double after_s = kLook * k / kPoses;
                const Pose at = integrate({0.0, 0.0, now.pose.theta}, arc, after_s);
                room = now.obstacles.clearance(now.footprint, at, kRoom, after_s);
                least = std::min(least, room);
            }
            if (least <= 0.0 || room <= most) continue;
            most = room;
            best = arc;
        }
    }
    return best;
}

} // namespace

Twist recover(const Situation &now, const Twist &chosen, double *memory) {
    double &x = memory[0], &y = memory[1], &still_s = memory[2], &escape_s = memory[3];
    const Vec2 here{now.pose.x, now.pose.y};
    still_s += now.dt_s;
    if (norm(here - Vec2{x, y}) > kProgress) {
        x = here.x;
        y = here.y;
        still_s = escape_s = 0.0;
    }
    if (escape_s <= 0.0 && still_s >= kPatience) {
        escape_s = kEscape;
        still_s = 0.0;
    }
    if (escape_s <= 0.0) return chosen;
    escape_s -= now.dt_s;
    return escape(now);
}

} // namespace adrl
