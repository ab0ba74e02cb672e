#include "control/local_control.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "control/recovery.hpp"
#include "planning/path_guide.hpp"

namespace adrl {
namespace {

constexpr double kTangent = 0.1; // metres of path that tell its direction

// Which way a car drives to get on: backward where its path leads behind it.
double gear_on(const Path &path, double along, double stop, const Pose &pose) {
    const Vec2 ahead = path.at(std::min(along + kTangent, stop)) - path.at(along);
    return ahead.x * std::cos(pose.theta) + ahead.y * std::sin(pose.theta) < 0.0 ? -1.0 : 1.0;
}

} // namespace

std::unique_ptr<LocalController> make_controller(const ControllerConfig &config, const Footprint &footprint,
                                                 const DriveLimits &limits, double dt_s) {
    if (const auto *dwa = std::get_if<DwaConfig>(&config)) return make_dwa(*dwa);
    if (const auto *pursuit = std::get_if<PursuitConfig>(&config)) return make_pure_pursuit(*pursuit);
    if (const auto *orca = std::get_if<OrcaConfig>(&config)) return make_orca(*orca);
    return make_mppi(std::get<MppiConfig>(config), footprint, limits, dt_s);
}

int control_memory(const ControllerConfig &config) {
    const auto *mppi = std::get_if<MppiConfig>(&config);
    return kRecoveryMemory + (mppi == nullptr ? 0 : mppi_memory(*mppi));
}

LocalControl::LocalControl(int num_robots, int num_threads, std::vector<ControlSetup> setups, const std::int64_t *kind,
                           double *memory)
    : num_robots_(num_robots), setups_(std::move(setups)), kind_(kind), memory_(memory) {
    for (const ControlSetup &one : setups_) memory_size_ = std::max(memory_size_, control_memory(one.controller));
    for (int k = 0; k < num_threads; ++k) {
        auto scratch = std::make_unique<Scratch>();
        for (const ControlSetup &one : setups_)
            scratch->controllers.push_back(make_controller(one.controller, one.footprint, one.limits, one.dt_s));
        scratch->path.reserve(kRouteCorners);
        stock_.add(std::move(scratch));
    }
}

Twist LocalControl::in_world(int i, const Moving &moving, const Path &path, double along, const DriveLimits &limits,
                             const Pose &pose, const Twist &twist, double time_s) {
    auto borrowed = stock_.borrow();
    Scratch &scratch = *borrowed;
    const ControlSetup &setup = setups_[kind_[i]];
    const double reach = scratch.controllers[kind_[i]]->reach(setup.footprint, limits, setup.dt_s);
    scratch.obstacles.gather(moving, pose, reach, time_s, setup.foresee);
    return decide(i, scratch, limits, pose, twist, path, along, &moving, time_s);
}

void LocalControl::on_maps(Replanner &maps, const std::uint8_t *mask, const double *pose, const double *twist,
                           const RouteCorners &routes, double *along, double *out) {
    maps.pool().run(num_robots_, [&](int first, int last) {
        auto borrowed = stock_.borrow();
        Scratch &scratch = *borrowed;
        for (int i = first; i < last; ++i) {
            if (!mask[i]) continue;
            const ControlSetup &setup = setups_[kind_[i]];
            const double reach = scratch.controllers[kind_[i]]->reach(setup.footprint, setup.limits, setup.dt_s);
            const Pose at{pose[3 * i], pose[3 * i + 1], pose[3 * i + 2]};
            scratch.obstacles.gather(maps.window(i), maps.shape(), maps.origin(i), at, reach);
            scratch.path.assign(routes.of(i));
            along[i] = come_along(scratch.path, {at.x, at.y}, along[i], kRouteWindow, setup.limits.is_car());
            const Twist now{twist[2 * i], twist[2 * i + 1]};
            const Twist command = decide(i, scratch, setup.limits, at, now, scratch.path, along[i], nullptr, 0.0);
            out[2 * i] = command.v;
            out[2 * i + 1] = command.w;
        }
    });
}

Twist LocalControl::decide(int i, Scratch &scratch, const DriveLimits &limits, const Pose &pose, const Twist &twist,
                           const Path &path, double along, const Moving *moving, double time_s) {
    const ControlSetup &setup = setups_[kind_[i]];
    const bool car = limits.is_car();
    const double stop = led_to(path, along, car);
    const double gear = car && limits.min_speed < 0.0 ? gear_on(path, along, stop, pose) : 1.0;
    const Situation now{scratch.obstacles, setup.footprint, limits, pose, twist, path, along, stop, gear,
                        setup.dt_s,        moving,          time_s};
    double *memory = memory_ + static_cast<std::ptrdiff_t>(i) * memory_size_;
    const Twist chosen = scratch.controllers[kind_[i]]->command(now, memory + kRecoveryMemory);
    return clip_command(recovers ? recover(now, chosen, memory) : chosen, limits);
}

} // namespace adrl
