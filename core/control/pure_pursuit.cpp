#include "control/pure_pursuit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "planning/path_guide.hpp"

namespace adrl {
namespace {

double stop_s(const DriveLimits &limits, double speed, double dt_s) {
    return std::abs(speed) / limits.max_acceleration + limits.lag_s + 2.0 * dt_s;
}

class PurePursuit final : public LocalController {
  public:
    explicit PurePursuit(const PursuitConfig &config) : config_(config) {}

    double reach(const Footprint &footprint, const DriveLimits &limits, double dt_s) const override {
        const double speed = std::max(limits.max_speed, -limits.min_speed);
        const double ahead = std::max(config_.max_allowed_time_to_collision, stop_s(limits, speed, dt_s)) * speed;
        return std::max(ahead, config_.max_lookahead_dist) + footprint.radius +
               std::max(config_.cost_scaling_dist, config_.margin_m);
    }

    Twist command(const Situation &now, double *) override {
        const Vec2 carrot = carrot_of(now);
        const double distance = norm(carrot);
        const double bearing = distance > 1e-9 ? std::atan2(now.gear * carrot.y, now.gear * carrot.x) : 0.0;
        const double clear = now.obstacles.clearance(now.footprint, {0.0, 0.0, now.pose.theta}, limit(), 0.0);
        // A robot that already stands closer than the margin must still be allowed to leave.
        const double margin = std::min(config_.margin_m, 0.5 * std::max(clear, 0.0));
        const bool car = now.limits.is_car();
        if (!car && std::abs(bearing) > config_.rotate_to_heading_min_angle) return turn(now, bearing, margin);
        // The same circle leads to a point behind, backward.
        double curvature = distance > 1e-9 ? 2.0 * carrot.y / (distance * distance) : 0.0;
        if (car)
            curvature =
                std::clamp(curvature, -1.0 / now.limits.min_turning_radius, 1.0 / now.limits.min_turning_radius);
        const double wanted = now.gear * regulated(now, curvature, clear);
        for (const double share : {1.0, 0.7, 0.5, 0.3, 0.15}) {
            const Twist arc = reachable(now, share * wanted, curvature);
            if (stays_clear(now, arc, distance, margin)) return lead_lag(arc, now.twist, now.limits, now.dt_s);
        }
        return car ? Twist{} : turn(now, bearing, margin);
    }

  private:
    double limit() const { return std::max(config_.cost_scaling_dist, 2.0 * config_.margin_m); }

    // The point of the path to head for, in the robot's frame.
    Vec2 carrot_of(const Situation &now) const {
        const double lookahead = std::clamp(config_.lookahead_time * std::abs(now.twist.v), config_.min_lookahead_dist,
                                            config_.max_lookahead_dist);
        const Vec2 here{now.pose.x, now.pose.y};
        const double corridor = now.footprint.radius + 0.5 * config_.margin_m;
        const Vec2 p =
            visible_waypoint(now.path, now.along, now.stop, lookahead,
                             [&](Vec2 point) { return now.obstacles.corridor_free({}, point - here, corridor); }) -
            here;
        const double c = std::cos(now.pose.theta), s = std::sin(now.pose.theta);
        return {c * p.x + s * p.y, c * p.y - s * p.x};
    }

    double regulated(const Situation &now, double curvature, double clear) const {
        const double most = now.gear < 0.0 ? -now.limits.min_speed : now.limits.max_speed;
        double speed = most;
        const double bend = std::abs(curvature);
        if (bend * config_.regulated_linear_scaling_min_radius > 1.0)
            speed = most / (bend * config_.regulated_linear_scaling_min_radius);
        if (clear < config_.cost_scaling_dist)
            speed = std::min(speed, most * config_.cost_scaling_gain * clear / config_.cost_scaling_dist);
        speed = std::max(speed, config_.regulated_linear_scaling_min_speed * most);
        return bend * speed > now.limits.max_yaw_rate ? now.limits.max_yaw_rate / bend : speed;
    }

    // The arc at the speed that the base can have after this period.
    static Twist reachable(const Situation &now, double speed, double curvature) {
        const double change = now.limits.max_acceleration * now.dt_s;
        const double v = std::clamp(speed, now.twist.v - change, now.twist.v + change);
        return {v, std::clamp(v * curvature, -now.limits.max_yaw_rate, now.limits.max_yaw_rate)};
    }

    // Whether the footprint stays clear on the arc, as far as the robot looks ahead or needs to stop.
    bool stays_clear(const Situation &now, const Twist &arc, double distance, double margin) const {
        const double to_carrot_s = std::abs(arc.v) > 1e-6 ? distance / std::abs(arc.v) : 0.0;
        const double ahead_s =
            std::max(std::min(config_.max_allowed_time_to_collision, to_carrot_s),
                     stop_s(now.limits, now.gear * std::max(now.gear * arc.v, now.gear * now.twist.v), now.dt_s));
        const double moved = (std::abs(arc.v) + std::abs(arc.w) * now.footprint.radius) * ahead_s;
        const int pieces = std::clamp(static_cast<int>(std::ceil(moved / 0.1)), 1, 64);
        for (int k = 1; k <= pieces; ++k) {
            const double after_s = ahead_s * k / pieces;
            const Pose at = integrate({0.0, 0.0, now.pose.theta}, arc, after_s);
            if (now.obstacles.clearance(now.footprint, at, 2.0 * margin + 1e-6, after_s) < margin) return false;
        }
        return true;
    }

    // Turns towards a bearing, and stops there.
    Twist turn(const Situation &now, double bearing, double margin) const {
        const double rate = std::min(now.limits.max_yaw_rate,
                                     std::sqrt(2.0 * now.limits.max_yaw_acceleration * 0.5 * std::abs(bearing)));
        const Twist spin{0.0, std::copysign(rate, bearing)};
        if (now.footprint.is_disc()) return spin;
        for (const double angle : {0.1, 0.3}) {
            const Pose at{0.0, 0.0, now.pose.theta + std::copysign(std::min(angle, std::abs(bearing)), bearing)};
            if (now.obstacles.clearance(now.footprint, at, 2.0 * margin + 1e-6, 0.0) < margin) return {0.0, 0.0};
        }
        return spin;
    }

    PursuitConfig config_;
};

} // namespace

std::unique_ptr<LocalController> make_pure_pursuit(const PursuitConfig &config) {
    return std::make_unique<PurePursuit>(config);
}

} // namespace adrl
