// Local controllers of N robots of several kinds: each is told what its robot knows, the true world or a map of its
// own.
#pragma once

#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include "control/controller.hpp"
#include "control/dwa.hpp"
#include "control/mppi.hpp"
#include "control/orca_control.hpp"
#include "control/pure_pursuit.hpp"
#include "planning/replanner.hpp"
#include "stock.hpp"

namespace adrl {

using ControllerConfig = std::variant<DwaConfig, PursuitConfig, MppiConfig, OrcaConfig>;

std::unique_ptr<LocalController> make_controller(const ControllerConfig &config, const Footprint &footprint,
                                                 const DriveLimits &limits, double dt_s);
// Numbers that are remembered of a robot.
int control_memory(const ControllerConfig &config);

struct ControlSetup {
    Footprint footprint;
    DriveLimits limits;
    double dt_s = 0.1;
    bool foresee = true; // in a known world discs are where they will be, and people walk on as they do
    ControllerConfig controller;
};

class LocalControl {
  public:
    // kind (N): which of the setups is each robot's. memory (N, the most of their control_memory()): all that changes,
    // zeros for robots that have just started. Both are the caller's. Decisions of at most num_threads robots are made
    // at once.
    LocalControl(int num_robots, int num_threads, std::vector<ControlSetup> setups, const std::int64_t *kind,
                 double *memory);

    // Whether robots that do not get on are led out by recover(). Off where somebody else drives, who may just stand.
    bool recovers = true;

    int num_robots() const { return num_robots_; }
    std::size_t num_kinds() const { return setups_.size(); }
    const std::int64_t *kinds() const { return kind_; }
    // Robot i on a path in a known world. limits: of its base, as it is today. moving: what it knows of what moves
    // there.
    Twist in_world(int i, const Moving &moving, const Path &path, double along, const DriveLimits &limits,
                   const Pose &pose, const Twist &twist, double time_s);
    // The robots of the mask (N) on routes of their own, in maps of their own: commands into out (N, 2). along (N): how
    // far along its route each has come. pose (N, 3), twist (N, 2).
    void on_maps(Replanner &maps, const std::uint8_t *mask, const double *pose, const double *twist,
                 const RouteCorners &routes, double *along, double *out);

  private:
    struct Scratch {
        std::vector<std::unique_ptr<LocalController>> controllers; // one a kind
        NearObstacles obstacles;
        Path path;
    };

    Twist decide(int i, Scratch &scratch, const DriveLimits &limits, const Pose &pose, const Twist &twist,
                 const Path &path, double along, const Moving *moving, double time_s);

    int num_robots_;
    std::vector<ControlSetup> setups_;
    const std::int64_t *kind_;
    int memory_size_ = 0;
    double *memory_;
    Stock<Scratch> stock_; // one a thread
};

} // namespace adrl
