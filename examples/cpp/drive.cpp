// adrl_drive POLICY: the policy's robot drives past three pillars to a goal 4 m ahead, in the core's own world.
// The braking check of the core has the last word: what it does not let through becomes a stop.
#include <algorithm>
#include <array>
#include <cstdio>
#include <deque>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <vector>

#include "drive/braking.hpp"
#include "policy.hpp"
#include "world/raycast.hpp"

namespace {

constexpr int kLongest = 300; // control periods
constexpr double kMargin = 0.02;

std::vector<adrl::Hit> hits_of(const Policy &policy, const std::vector<float> &ranges) {
    std::vector<adrl::Hit> hits;
    for (int i = 0; i < policy.num_beams(); ++i) {
        if (ranges[i] >= policy.max_range()) continue;
        const double angle = policy.angle_min() + i * policy.angle_increment();
        const adrl::Vec2 end{ranges[i] * std::cos(angle), ranges[i] * std::sin(angle)};
        hits.push_back({adrl::to_world(policy.mount(), end), kMargin + 0.5 * policy.angle_increment() * ranges[i]});
    }
    return hits;
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 2) {
        std::cerr << "usage: adrl_drive POLICY.safetensors\n";
        return 2;
    }
    try {
        const Policy policy(argv[1]);
        if (policy.latency() > 0.0) throw std::runtime_error("its robot has latency, which this example leaves out");
        const std::array<double, 9> pillars{1.2, 0.4, 0.25, 2.4, -0.5, 0.3, 2.9, 0.7, 0.25};
        const std::array<std::int32_t, 1> none{0};
        const adrl::World world(pillars, {}, none, {}, {}, nullptr, 0, 0, 1.0, {});
        const adrl::Footprint footprint = policy.footprint();
        const double period = policy.period();
        const adrl::DriveLimits limits = policy.drive_limits();
        const adrl::Braking brakes(footprint, limits, period);
        const adrl::Beams beams(policy.num_beams(), policy.angle_min(), policy.angle_increment());
        const adrl::Vec2 goal{4.0, 0.0};
        adrl::DriveState robot;
        const double span = limits.max_speed - limits.min_speed;
        Action last{static_cast<float>(-2.0 * limits.min_speed / span - 1.0), 0.0F}; // standing still
        std::deque<Look> looks;                                                      // the newest last
        const std::size_t kept = std::max(policy.history_steps() + 1, policy.num_followed());
        // So many control periods ago; before the first look it was as it is there.
        const auto look = [&](std::size_t ago) { return looks[ago < looks.size() ? looks.size() - 1 - ago : 0]; };
        std::vector<double> exact(beams.padded());
        for (int step = 0; step < kLongest; ++step) {
            raycast(world, adrl::DiscPlaces(), compose(robot.pose, policy.mount()), beams, policy.max_range(),
                    exact.data());
            looks.push_back({std::vector<float>(exact.begin(), exact.begin() + beams.count()), robot.pose});
            if (looks.size() > kept) looks.pop_front();
            const adrl::Vec2 way = goal - adrl::Vec2{robot.pose.x, robot.pose.y};
            const double c = std::cos(robot.pose.theta), s = std::sin(robot.pose.theta);
            const adrl::Vec2 ahead{c * way.x + s * way.y, c * way.y - s * way.x};
            if (adrl::norm(way) < 0.3) {
                std::printf("at the goal after %.1f s\n", step * period);
                return 0;
            }
            const std::vector<adrl::Vec2> path(policy.path_points().size(), ahead); // none is known
            std::vector<Look> followed;
            for (int ago = policy.num_followed() - 1; ago >= 0; --ago) followed.push_back(look(ago));
            const Look past = look(policy.history_steps());
            last = policy.act(look(0), past, policy.tracks(followed), ahead, path, robot.twist, last);
            adrl::Twist command = policy.velocity(last);
            std::vector<adrl::Hit> hits = hits_of(policy, looks.back().ranges);
            const std::array<adrl::Order, 1> until_next{adrl::Order{command, period}};
            if (!brakes.stays_clear(robot.twist, until_next, hits)) command = {};
            robot = brakes.roll(robot, std::array{adrl::Order{command, period}});
            if (clearance(world, adrl::DiscPlaces(), footprint, robot.pose, 1.0) <= 0.0) {
                std::printf("hit an obstacle at (%.2f, %.2f)\n", robot.pose.x, robot.pose.y);
                return 1;
            }
        }
        std::printf("not at the goal in time\n");
        return 1;
    } catch (const std::exception &error) {
        std::cerr << "adrl_drive: " << error.what() << "\n";
        return 1;
    }
}
