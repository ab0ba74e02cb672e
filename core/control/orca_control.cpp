#include "control/orca_control.hpp"

#include <algorithm>
#include <cmath>

#include "planning/path_guide.hpp"
#include "world/avoidance.hpp"

namespace adrl {
namespace {

constexpr double kStands = 0.05; // m/s; slower is taken to stand

class Orca final : public LocalController {
  public:
    explicit Orca(const OrcaConfig &config) : config_(config) {}

    double reach(const Footprint &footprint, const DriveLimits &, double) const override {
        return config_.lookahead + footprint.radius + config_.space_m;
    }

    Twist command(const Situation &now, double *) override {
        const World &world = now.moving->world();
        world.lay_walls();
        const Vec2 here{now.pose.x, now.pose.y}, heading{std::cos(now.pose.theta), std::sin(now.pose.theta)};
        const double body = now.footprint.radius;
        Neighbours others(here, body);
        now.moving->each(now.time_s, [&](const Mover &mover) {
            others.offer(mover, norm(mover.velocity) < kStands ? 1.0 : config_.share);
        });
        const Vec2 v = velocity_among(world,
                                      {{here, now.twist.v * heading, body + config_.space_m},
                                       body,
                                       preferred(now),
                                       now.limits.max_speed,
                                       config_.horizon_s,
                                       config_.wall_horizon_s,
                                       now.dt_s},
                                      others);
        if (norm(v) < 1e-6) return lead_lag({}, now.twist, now.limits, now.dt_s);
        const double ahead = dot(heading, v), angle = std::atan2(cross(heading, v), ahead);
        return lead_lag({std::max(ahead, 0.0), angle / config_.turn_s}, now.twist, now.limits, now.dt_s);
    }

  private:
    // Full speed towards a point of the path that the robot sees.
    Vec2 preferred(const Situation &now) const {
        const Vec2 here{now.pose.x, now.pose.y};
        const double corridor = now.footprint.radius + 0.5 * config_.space_m;
        const auto is_free = [&](Vec2 point) { return now.obstacles.corridor_free({}, point - here, corridor); };
        const Vec2 way = visible_waypoint(now.path, now.along, now.stop, config_.lookahead, is_free) - here;
        const double far = norm(way);
        return far > 1e-9 ? (now.limits.max_speed / far) * way : Vec2{};
    }

    OrcaConfig config_;
};

} // namespace

std::unique_ptr<LocalController> make_orca(const OrcaConfig &config) { return std::make_unique<Orca>(config); }

} // namespace adrl
