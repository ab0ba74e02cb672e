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

} // namespace

Overlay::Overlay(const Fan &seen, const Fan &surface, double scale, int stride)
    : surface_(surface), scale_(scale), turn_(2.0 * std::numbers::pi / std::abs(surface.increment)) {
    const int count = static_cast<int>(seen.ranges.size());
    for (int i = 0; i < count; i += stride) {
        if (std::isfinite(seen.ranges[i])) seen_.push_back(hit_at(seen, i));
    }
    hits_.resize(surface.ranges.size());
    for (std::size_t i = 0; i < hits_.size(); ++i) {
        if (std::isfinite(surface.ranges[i])) hits_[i] = hit_at(surface, static_cast<int>(i));
    }
}

// From what the beams to both sides of a point have hit; below 0 where they do not tell.
double Overlay::distance(Vec2 p) const {
    const int count = static_cast<int>(hits_.size());
    double beam = (std::atan2(p.y, p.x) - surface_.angle_min) / surface_.increment;
    beam -= turn_ * std::floor(beam / turn_);
    const int before = static_cast<int>(beam);
    int after = before + 1;
    if (after >= count && turn_ < count + 0.5) after -= count;
    if (before >= count || after >= count) return -1.0;
    const double r = surface_.ranges[before], s = surface_.ranges[after];
    if (std::isnan(r) || std::isnan(s) || norm(p) > kWithinReach * surface_.max_range) return -1.0;
    if (std::isinf(r) && std::isinf(s)) return scale_;
    const Vec2 a = hits_[before], b = hits_[after];
    if (std::isinf(r)) return norm(p - b);
    if (std::isinf(s)) return norm(p - a);
    if (std::abs(r - s) <= kContiguous * std::min(r, s)) return distance_to_line(p, a, b);
    return std::min(norm(p - a), norm(p - b));
}

Misfit Overlay::misfit(const Pose &motion) const {
    const double c = std::cos(motion.theta), s = std::sin(motion.theta);
    Misfit out;
    double sum = 0.0;
    for (const Vec2 q : seen_) {
        const double away = distance({motion.x + c * q.x - s * q.y, motion.y + s * q.x + c * q.y});
        if (away < 0.0) continue;
        sum += std::min(away / scale_, 1.0);
        ++out.points;
    }
    if (out.points > 0) out.mean = sum / out.points;
    return out;
}

} // namespace adrl
