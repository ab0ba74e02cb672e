// Robots among obstacles of every kind, with buffers of their own.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "sim/batch_sim.hpp"

namespace adrl {

// Circles, boxes, walls, moving discs and a turned bitmap around the origin.
inline std::shared_ptr<World> crowded_world() {
    const std::vector<double> circles{2.0, 1.0, 0.4, -1.5, 2.0, 0.3, 1.0, -2.0, 0.2};
    const std::vector<double> corners{-3.0, -1.0, -2.0, -1.0, -2.0, 0.5, 3.0, 2.0, 4.0, 2.0, 3.5, 3.0};
    const std::vector<std::int32_t> offsets{0, 3, 6};
    const std::vector<double> walls{-5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, 5.0};
    const std::vector<double> discs{-3.0, 3.0, 3.0, 3.0, 0.3, 0.5, 0.2, std::numeric_limits<double>::infinity()};
    std::vector<std::uint8_t> solid(20 * 30, 0);
    for (std::size_t i = 0; i < solid.size(); i += 17) solid[i] = 1;
    return std::make_shared<World>(circles, corners, offsets, walls, discs, solid.data(), 20, 30, 0.1,
                                   Pose{-1.0, -4.0, 0.3});
}

inline std::shared_ptr<const Crowd> three_people() {
    Crowd crowd;
    crowd.way_points = {{-3.0, 2.5}, {3.0, 1.5}, {0.0, -1.0}, {0.5, -4.0}, {-2.5, -3.0}};
    crowd.walkers = {{0.3, 1.2, 0.5, 0.2, 0, false, 0, 2},
                     {0.25, 1.0, 0.0, 0.3, -1, true, 2, 4},
                     {0.3, 0.0, 0.5, 0.2, 0, false, 4, 5}};
    crowd.legs = true;
    return std::make_shared<const Crowd>(crowd);
}

class SimFixture {
  public:
    SimFixture(int n, int num_threads, bool polygon, const ControllerConfig &controller = DwaConfig{})
        : command(2 * n, 0.4), params(kNumParams * n), pose(3 * n), odometry(3 * n), twist(2 * n), clearance(n),
          least(n), waypoint(2 * n), path_ahead(2 * kPathAhead.size() * n), route_left(n), time(n), travelled(n),
          memory(kMemory * n), plans(2 * n), remembered(static_cast<std::size_t>(n) * control_memory(controller)),
          ranges(static_cast<std::size_t>(kBeams) * n), active(n, 1), reached(n), collided(n), at_fault(n), mask(n, 1),
          everyone(n, 1), seed(n), people(static_cast<std::size_t>(kMaxPeople) * kPersonNumbers * n), kind(n),
          control(n, num_threads, {{robot(polygon).footprint, DriveLimits{}, 0.1, true, controller}}, kind.data(),
                  remembered.data()),
          sim(n, num_threads, {{robot(polygon), SimConfig{}}}, buffers()) {
        const auto world = crowded_world();
        world->lay_walls();
        for (int i = 0; i < n; ++i) {
            double *row = params.data() + static_cast<std::ptrdiff_t>(i) * kNumParams;
            row[kSpeedGain] = row[kYawGain] = 1.0;
            row[kMaxAcceleration] = 2.0;
            row[kMaxYawAcceleration] = 6.0;
            row[kLag] = 0.05;
            row[kLatency] = 0.13;
            row[kRangeNoise] = 0.01;
            row[kDropout] = 0.01;
            seed[i] = static_cast<std::uint64_t>(i);
            const std::vector<double> path{0.0, 0.0, 2.0, 0.0, 2.0, 4.0};
            sim.set_task(i, std::make_shared<const Task>(
                                Task{world, {0.0, 0.0, 0.1 * i}, {2.0, 4.0}, 0.3, Path(path), three_people()}));
        }
        sim.reset(mask.data());
    }

    // Plans, does as planned, and starts again half of the robots now and then.
    void run(int steps) {
        for (int k = 0; k < steps; ++k) {
            sim.plan(everyone.data(), control, plans.data());
            std::copy(plans.begin(), plans.end(), command.begin());
            sim.step();
            for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = (i + k) % 2 == 0;
            if (k % 4 == 3) sim.reset(mask.data());
        }
    }

    static constexpr int kBeams = 45;
    std::vector<double> command, params, pose, odometry, twist, clearance, least, waypoint, path_ahead, route_left,
        time, travelled, memory, plans, remembered;
    std::vector<float> ranges;
    std::vector<std::uint8_t> active, reached, collided, at_fault, mask, everyone;
    std::vector<std::uint64_t> seed;
    std::vector<double> people;
    std::vector<std::int64_t> kind;
    LocalControl control;
    BatchSim sim;

  private:
    static Robot robot(bool polygon) {
        Footprint footprint{0.2, {}};
        if (polygon) footprint = {0.36, {{0.3, -0.2}, {0.3, 0.2}, {-0.3, 0.2}, {-0.3, -0.2}}};
        return {footprint, DriveLimits{}, Beams(kBeams, -3.0, 6.0 / (kBeams - 1)), Pose{0.1, 0.0, 0.2}, 6.0, 0.1};
    }

    SimBuffers buffers() {
        return {kind.data(),      kBeams,           command.data(),  active.data(),     seed.data(),
                params.data(),    ranges.data(),    pose.data(),     odometry.data(),   twist.data(),
                clearance.data(), least.data(),     waypoint.data(), path_ahead.data(), route_left.data(),
                time.data(),      travelled.data(), reached.data(),  collided.data(),   at_fault.data(),
                memory.data(),    people.data()};
    }
};

} // namespace adrl
