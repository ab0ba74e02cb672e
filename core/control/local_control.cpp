#include "control/local_control.hpp"

#include <utility>

namespace adrl {
namespace {

constexpr double kRouteWindow = 3.0; // the robot is looked for so far ahead of where it was on its route, metres

} // namespace

std::unique_ptr<LocalController> make_controller(const ControllerConfig &config) {
    return make_dwa(std::get<DwaConfig>(config));
}

class LocalControl::Borrowed {
  public:
    explicit Borrowed(LocalControl &owner) : owner_(owner) {
        const std::scoped_lock lock(owner.mutex_);
        scratch_ = std::move(owner.stock_.back());
        owner.stock_.pop_back();
    }
    ~Borrowed() {
        const std::scoped_lock lock(owner_.mutex_);
        owner_.stock_.push_back(std::move(scratch_));
    }
    Borrowed(const Borrowed &) = delete;
    Borrowed &operator=(const Borrowed &) = delete;
    Scratch &operator*() { return *scratch_; }

  private:
    LocalControl &owner_;
    std::unique_ptr<Scratch> scratch_;
};

LocalControl::LocalControl(int num_robots, int num_threads, ControlSetup setup, double *memory)
    : num_robots_(num_robots), setup_(std::move(setup)), memory_(memory) {
    for (int k = 0; k < num_threads; ++k) {
        stock_.push_back(std::make_unique<Scratch>());
        stock_.back()->controller = make_controller(setup_.controller);
    }
    memory_size_ = stock_.front()->controller->memory_size();
}

Twist LocalControl::in_world(int i, const World &world, const Path &path, double along, const DriveLimits &limits,
                             const Pose &pose, const Twist &twist, double time_s) {
    Borrowed borrowed(*this);
    Scratch &scratch = *borrowed;
    const double reach = scratch.controller->reach(setup_.footprint, limits, setup_.dt_s);
    scratch.obstacles.gather(world, pose, reach, time_s, setup_.foresee);
    return decide(i, scratch, limits, pose, twist, path, along);
}

Twist LocalControl::on_map(int i, const std::int8_t *log_odds, const WindowShape &shape, const WindowOrigin &origin,
                           const OwnRoute &route, const Pose &pose, const Twist &twist) {
    Borrowed borrowed(*this);
    Scratch &scratch = *borrowed;
    const double reach = scratch.controller->reach(setup_.footprint, setup_.limits, setup_.dt_s);
    scratch.obstacles.gather(log_odds, shape, origin, pose, reach);
    scratch.path.assign({route.corners, 2 * static_cast<std::size_t>(route.count)});
    *route.along = scratch.path.project({pose.x, pose.y}, *route.along, *route.along + kRouteWindow);
    return decide(i, scratch, setup_.limits, pose, twist, scratch.path, *route.along);
}

Twist LocalControl::decide(int i, Scratch &scratch, const DriveLimits &limits, const Pose &pose, const Twist &twist,
                           const Path &path, double along) {
    const Situation now{scratch.obstacles, setup_.footprint, limits, pose, twist, path, along, setup_.dt_s};
    double *memory = memory_ + static_cast<std::ptrdiff_t>(i) * memory_size_;
    return clip_command(scratch.controller->command(now, memory), limits);
}

} // namespace adrl
