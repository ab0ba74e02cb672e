#include "drive/braking.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {
namespace {

constexpr double kSpacing = 0.01;   // metres that any point of the robot moves between two poses that are looked at
constexpr double kTolerance = 1e-6; // metres
constexpr double kAtRest = 1e-3;    // m/s and rad/s: a lagging base never quite stops
constexpr double kApproach = 0.05;  // m/s at which the robot itself comes nearer, and more
constexpr int kMaxPeriods = 1000;

bool at_rest(Twist twist) { return std::abs(twist.v) < kAtRest && std::abs(twist.w) < kAtRest; }

// A point in the frame of a robot at `pose`.
Vec2 seen_from(const Pose &pose, double c, double s, Vec2 p) {
    const Vec2 d = p - Vec2{pose.x, pose.y};
    return {c * d.x + s * d.y, c * d.y - s * d.x};
}

} // namespace

// Calls visit(from, mean twist, duration) for each arc; stops when it says false.
template <class Visit>
bool Braking::drive_on(DriveState &state, const Order &order, Visit visit) const {
    for (double left = order.duration_s; left > 1e-9;) {
        const double span = std::min(left, dt_s_);
        const Twist next = advance_twist(state.twist, order.twist, limits_, span);
        const Twist mean = mean_twist(state.twist, next, limits_);
        if (!visit(state.pose, mean, span)) return false;
        state.pose = integrate(state.pose, mean, span);
        state.twist = next;
        left -= span;
    }
    return true;
}

DriveState Braking::roll(DriveState state, std::span<const Order> orders) const {
    for (const Order &order : orders) {
        drive_on(state, order, [](const Pose &, const Twist &, double) { return true; });
    }
    return state;
}

// An upper bound on how far any place of the robot gets.
double Braking::reach(Twist twist, std::span<const Order> orders) const {
    DriveState state{{}, twist};
    double way = 0.0;
    const auto add = [&](const Pose &, const Twist &mean, double span) {
        way += std::abs(mean.v) * span;
        return true;
    };
    for (const Order &order : orders) drive_on(state, order, add);
    for (int k = 0; k < kMaxPeriods && !at_rest(state.twist); ++k) drive_on(state, {{}, dt_s_}, add);
    return way;
}

bool Braking::stays_clear(Twist twist, std::span<const Order> orders, std::span<Hit> hits,
                          std::span<const MovingHit> moving) const {
    const double way = reach(twist, orders);
    auto count = hits.size();
    for (std::size_t i = 0; i < count;) {
        Hit &hit = hits[i];
        const bool far = norm(hit.point) - footprint_.radius > way + hit.margin + kSpacing;
        const double clear = far ? 0.0 : distance_to_point(footprint_, hit.point);
        if (clear <= 0.0) {
            std::swap(hit, hits[--count]);
            continue;
        }
        // Between two poses the robot comes no more than half their spacing nearer.
        hit.margin = std::min(hit.margin + 0.5 * kSpacing, clear - kTolerance);
        ++i;
    }
    const auto near = hits.first(count);
    const auto clear_at = [&](const Pose &pose) {
        const double c = std::cos(pose.theta), s = std::sin(pose.theta);
        return std::all_of(near.begin(), near.end(), [&](const Hit &hit) {
            const Vec2 p = seen_from(pose, c, s, hit.point);
            return norm(p) >= footprint_.radius + hit.margin || distance_to_point(footprint_, p) >= hit.margin;
        });
    };
    // From one pose to the next, after_s from now.
    const auto meets = [&](const MovingHit &hit, const Pose &from, const Pose &to, double after_s, double took_s) {
        const Vec2 end = hit.seen.point + (hit.age_s + after_s) * hit.velocity, here{to.x, to.y};
        if (origin_to_segment(hit.seen.point - here, end - here) >= footprint_.radius + hit.seen.margin) return false;
        const auto away = [&](const Pose &pose) {
            const double c = std::cos(pose.theta), s = std::sin(pose.theta);
            return distance_to_segment(footprint_, seen_from(pose, c, s, hit.seen.point), seen_from(pose, c, s, end));
        };
        const double clear = away(to);
        return clear < hit.seen.margin && away(from) - clear > kApproach * took_s;
    };
    const double turning = footprint_.is_disc() ? 0.0 : footprint_.radius;
    double after_s = 0.0;
    const auto clear_on = [&](const Pose &from, const Twist &mean, double span) {
        const double moved = (std::abs(mean.v) + std::abs(mean.w) * turning) * span;
        const int pieces = std::max(1, static_cast<int>(std::ceil(moved / kSpacing)));
        const double took_s = span / pieces;
        Pose before = from;
        for (int k = 1; k <= pieces; ++k) {
            const Pose pose = integrate(from, mean, took_s * k);
            after_s += took_s;
            if (!clear_at(pose)) return false;
            if (std::any_of(moving.begin(), moving.end(),
                            [&](const MovingHit &hit) { return meets(hit, before, pose, after_s, took_s); }))
                return false;
            before = pose;
        }
        return true;
    };
    DriveState state{{}, twist};
    for (const Order &order : orders) {
        if (!drive_on(state, order, clear_on)) return false;
    }
    for (int k = 0; k < kMaxPeriods && !at_rest(state.twist); ++k) {
        if (!drive_on(state, {{}, dt_s_}, clear_on)) return false;
    }
    return true;
}

} // namespace adrl
