// Points, poses and angles shared by every room.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "clones.hpp"

namespace adrl {

struct Vec2 {
    double x = 0.0;
    double y = 0.0;
};

ADRL_INLINE Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
ADRL_INLINE Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
ADRL_INLINE Vec2 operator*(double s, Vec2 a) { return {s * a.x, s * a.y}; }
ADRL_INLINE double dot(Vec2 a, Vec2 b) { return a.x * b.x + a.y * b.y; }
ADRL_INLINE double cross(Vec2 a, Vec2 b) { return a.x * b.y - a.y * b.x; }
ADRL_INLINE double norm(Vec2 a) { return std::sqrt(dot(a, a)); }

// Position and heading in the world, metres and radians.
struct Pose {
    double x = 0.0;
    double y = 0.0;
    double theta = 0.0;
};

// Forward speed and yaw rate of a differential drive, m/s and rad/s.
struct Twist {
    double v = 0.0;
    double w = 0.0;
};

// The same angle in (-pi, pi].
inline double wrap_angle(double angle) {
    const double wrapped = std::remainder(angle, 2.0 * std::numbers::pi);
    return wrapped <= -std::numbers::pi ? std::numbers::pi : wrapped;
}

// Arc tangent of y / x in (-pi, pi] to 2e-5 rad, without branches so that a loop over it becomes vector code.
// Minimax polynomial on [0, 1] (Abramowitz and Stegun 4.4.49 form), reflected into the other octants.
ADRL_INLINE double rough_atan2(double y, double x) {
    const double ax = std::abs(x);
    const double ay = std::abs(y);
    const double high = ax > ay ? ax : ay;
    const double low = ax > ay ? ay : ax;
    const double q = low / (high + 1e-300);
    const double q2 = q * q;
    double angle = q * (0.9998660 + q2 * (-0.3302995 + q2 * (0.1801410 + q2 * (-0.0851330 + q2 * 0.0208351))));
    angle = ay > ax ? 0.5 * std::numbers::pi - angle : angle;
    angle = x < 0.0 ? std::numbers::pi - angle : angle;
    return y < 0.0 ? -angle : angle;
}

// A point given in the frame of `pose`, in the world.
inline Vec2 to_world(const Pose &pose, Vec2 local) {
    const double c = std::cos(pose.theta);
    const double s = std::sin(pose.theta);
    return {pose.x + c * local.x - s * local.y, pose.y + s * local.x + c * local.y};
}

// Pose `local`, given in the frame of `pose`, in the world.
inline Pose compose(const Pose &pose, const Pose &local) {
    const Vec2 p = to_world(pose, {local.x, local.y});
    return {p.x, p.y, pose.theta + local.theta};
}

// Distance from the origin to the segment a-b.
ADRL_INLINE double origin_to_segment(Vec2 a, Vec2 b) {
    const Vec2 e = b - a;
    const double length2 = dot(e, e);
    double u = length2 > 0.0 ? -dot(a, e) / length2 : 0.0;
    u = u < 0.0 ? 0.0 : (u > 1.0 ? 1.0 : u);
    return norm(a + u * e);
}

inline bool segments_cross(Vec2 a, Vec2 b, Vec2 c, Vec2 d) {
    const double c_side = cross(b - a, c - a);
    const double d_side = cross(b - a, d - a);
    const double a_side = cross(d - c, a - c);
    const double b_side = cross(d - c, b - c);
    return c_side * d_side <= 0.0 && a_side * b_side <= 0.0 && (c_side != 0.0 || d_side != 0.0);
}

// Distance between the segments a-b and c-d; 0 where they cross.
inline double segment_to_segment(Vec2 a, Vec2 b, Vec2 c, Vec2 d) {
    if (segments_cross(a, b, c, d)) return 0.0;
    const double to_cd = std::min(origin_to_segment(c - a, d - a), origin_to_segment(c - b, d - b));
    return std::min({to_cd, origin_to_segment(a - c, b - c), origin_to_segment(a - d, b - d)});
}

} // namespace adrl
