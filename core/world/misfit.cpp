#include "world/misfit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace adrl {
namespace {

constexpr double kContiguous = 0.15;  // neighbouring ranges that differ by a smaller part are of one surface
constexpr double kWithinReach = 0.97; // of max_range: what is farther away may be out of reach by now

Vec2 hit_at(const Fan &fan, int beam) {
    const double angle = fan.angle_min + beam * fan.increment;
    return fan.ranges[beam] * Vec2{std::cos(angle), std::sin(angle)};
}

double distance_to_line(Vec2 p, Vec2 a, Vec2 b) {
    const Vec2 along = b - a;
    const double length = norm(along);
    return length > 1e-6 ? std::abs(cross(along, p - a)) / length : norm(p - a);
}

// The distance of a point from what the beams to both sides of it have hit; below 0 where they do not tell.
double distance(const Fan &fan, Vec2 p, double range, double scale) {
    const int count = static_cast<int>(fan.ranges.size());
    const double turn = 2.0 * std::numbers::pi / std::abs(fan.increment);
    double beam = (std::atan2(p.y, p.x) - fan.angle_min) / fan.increment;
    beam -= turn * std::floor(beam / turn);
    const int before = static_cast<int>(beam);
    int after = before + 1;
    if (after >= count && turn < count + 0.5) after -= count;
    if (before >= count || after >= count) return -1.0;
    const double r = fan.ranges[before], s = fan.ranges[after];
    if (std::isnan(r) || std::isnan(s) || range > kWithinReach * fan.max_range) return -1.0;
    if (std::isinf(r) && std::isinf(s)) return scale;
    if (std::isinf(r)) return norm(p - hit_at(fan, after));
    if (std::isinf(s)) return norm(p - hit_at(fan, before));
    const Vec2 a = hit_at(fan, before), b = hit_at(fan, after);
    if (std::abs(r - s) <= kContiguous * std::min(r, s)) return distance_to_line(p, a, b);
    return std::min(norm(p - a), norm(p - b));
}

} // namespace

Misfit misfit(const Fan &seen, const Fan &surface, const Pose &motion, double scale, int stride) {
    const double c = std::cos(motion.theta), s = std::sin(motion.theta);
    const int count = static_cast<int>(seen.ranges.size());
    Misfit out;
    double sum = 0.0;
    for (int i = 0; i < count; i += stride) {
        if (!std::isfinite(seen.ranges[i])) continue;
        const Vec2 q = hit_at(seen, i);
        const Vec2 p{motion.x + c * q.x - s * q.y, motion.y + s * q.x + c * q.y};
        const double away = distance(surface, p, norm(p), scale);
        if (away < 0.0) continue;
        sum += std::min(away / scale, 1.0);
        ++out.points;
    }
    if (out.points > 0) out.mean = sum / out.points;
    return out;
}

} // namespace adrl
