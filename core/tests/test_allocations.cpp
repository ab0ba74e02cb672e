// Steps, plans, routes and resets allocate nothing once the simulator or planner stands: the global operator new
// counts.
#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>
#include <vector>

#include <doctest/doctest.h>

#include "planning/car_planner.hpp"
#include "planning/grid.hpp"
#include "planning/route_planner.hpp"
#include "random.hpp"
#include "sim_fixture.hpp"

namespace {

std::atomic<long> allocations{0};

void *counted(std::size_t size, std::size_t alignment) {
    allocations.fetch_add(1);
    void *p = std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
    if (p == nullptr) throw std::bad_alloc();
    return p;
}

} // namespace

void *operator new(std::size_t size) { return counted(size == 0 ? 1 : size, alignof(std::max_align_t)); }
void *operator new[](std::size_t size) { return operator new(size); }
void *operator new(std::size_t size, std::align_val_t alignment) {
    return counted(size == 0 ? 1 : size, static_cast<std::size_t>(alignment));
}
void *operator new[](std::size_t size, std::align_val_t alignment) { return operator new(size, alignment); }
void operator delete(void *p) noexcept { std::free(p); }
void operator delete[](void *p) noexcept { std::free(p); }
void operator delete(void *p, std::size_t) noexcept { std::free(p); }
void operator delete[](void *p, std::size_t) noexcept { std::free(p); }
void operator delete(void *p, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void *p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void *p, std::size_t, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void *p, std::size_t, std::align_val_t) noexcept { std::free(p); }

namespace adrl {

TEST_CASE("the counter counts") {
    const long before = allocations.load();
    delete new int(1);
    CHECK(allocations.load() > before);
}

const ControllerConfig kControllers[] = {DwaConfig{}, PursuitConfig{}, MppiConfig{}, OrcaConfig{}};

TEST_CASE("nothing is allocated after construction") {
    for (const ControllerConfig &controller : kControllers) {
        for (const bool polygon : {false, true}) {
            for (const int threads : {1, 2, 3}) {
                CAPTURE(controller.index());
                CAPTURE(polygon);
                CAPTURE(threads);
                SimFixture fixture(24, threads, polygon, controller);
                fixture.run(3); // warm-up: threads start
                const long before = allocations.load();
                fixture.run(20);
                CHECK(allocations.load() == before);
            }
        }
    }
}

TEST_CASE("robots on maps of their own allocate nothing") {
    constexpr int kRobots = 6, kSide = 120;
    std::vector<std::int8_t> log_odds(static_cast<std::size_t>(kRobots) * kSide * kSide);
    std::vector<std::int64_t> origin(2 * kRobots);
    std::vector<std::uint8_t> parity(kRobots), found(kRobots), mask(kRobots, 1);
    std::vector<double> waypoint(2 * kRobots), length(kRobots), pose(3 * kRobots), twist(2 * kRobots, 0.3),
        goal(2 * kRobots, 2.5), corners(2L * kRobots * kRouteCorners), along(kRobots), out(2 * kRobots),
        ahead(2 * kPathAhead.size() * kRobots);
    std::vector<std::int32_t> counts(kRobots);
    std::vector<float> ranges(static_cast<std::size_t>(kRobots) * SimFixture::kBeams);
    for (std::size_t i = 0; i < ranges.size(); ++i) ranges[i] = 0.8F + static_cast<float>(i % 7);
    ReplannerSetup setup;
    setup.shape = {kSide, kSide, 0.05};
    setup.beams = Beams(SimFixture::kBeams, -3.0, 6.0 / (SimFixture::kBeams - 1));
    ReplannerSetup wide = setup; // a second kind
    wide.costs.inflation = 0.4;
    std::vector<std::int64_t> kind{0, 1, 0, 1, 1, 0};
    Replanner maps(kRobots, 2, {setup, wide},
                   {kind.data(), SimFixture::kBeams, log_odds.data(), origin.data(), parity.data(), waypoint.data(),
                    length.data(), found.data()});
    const RouteCorners routes{corners.data(), counts.data()};
    for (const ControllerConfig &controller : kControllers) {
        if (std::holds_alternative<OrcaConfig>(controller)) continue; // drives in a known world alone
        CAPTURE(controller.index());
        std::vector<double> memory(static_cast<std::size_t>(kRobots) * control_memory(controller));
        const ControlSetup small{{0.2, {}}, DriveLimits{}, 0.1, true, controller};
        const ControlSetup large{{0.35, {}}, DriveLimits{}, 0.2, true, controller};
        LocalControl control(kRobots, 2, {small, large}, kind.data(), memory.data());
        const long before = allocations.load();
        maps.restart(mask.data(), pose.data());
        for (int k = 0; k < 5; ++k) {
            maps.observe(mask.data(), pose.data(), ranges.data());
            maps.plan(mask.data(), pose.data(), goal.data(), &routes);
            maps.ahead(mask.data(), pose.data(), routes, along.data(), ahead.data());
            control.on_maps(maps, mask.data(), pose.data(), twist.data(), routes, along.data(), out.data());
        }
        CHECK(allocations.load() == before);
        CHECK(counts[0] >= 2);
    }
}

TEST_CASE("a route allocates nothing, whatever the window") {
    constexpr int kSide = 200;
    std::vector<std::int8_t> window(kSide * kSide);
    for (const bool headings : {false, true}) {
        CAPTURE(headings);
        RouteCosts costs;
        costs.inflation = 0.1;
        costs.headings = headings;
        RoutePlanner planner(kSide, kSide, 0.05, costs);
        long allocated = 0;
        std::size_t longest = 0;
        for (int k = 0; k < 40; ++k) {
            const double density = 0.002 * (k % 10); // from the empty window to one that has no way through
            const std::int8_t solid = k % 4 < 2 ? Evidence().wall() : std::int8_t{1}; // for good, or to be passed
            for (std::size_t i = 0; i < window.size(); ++i)
                window[i] = uniform01(mix64(random_key(k, i))) < density ? solid : std::int8_t{0};
            const long before = allocations.load();
            const Route route =
                planner.plan(window.data(), Evidence().wall(), {k, 5}, {kSide - 1 - 2 * k, kSide - 7}, 0.3 * k);
            allocated += allocations.load() - before;
            longest = std::max(longest, route.cells->size());
        }
        CHECK(allocated == 0);
        CHECK(longest > kSide / 2);
    }
}

TEST_CASE("a car's path allocates nothing, and is the same again") {
    constexpr int kSide = 200;
    constexpr double kResolution = 0.05;
    // Two walls with a gap each.
    const std::vector<double> walls{3.0, 0.0, 3.0, 7.0, 6.0, 3.0, 6.0, 10.0};
    const World world({}, {}, {}, walls, {}, nullptr, 0, 0, 1.0, {});
    std::vector<float> clearance(kSide * kSide);
    clearance_field(world, {0.0, 0.0, kSide, kSide, kResolution}, 1.0, clearance.data());
    const std::vector<Vec2> corners{{0.3, 0.2}, {-0.3, 0.2}, {-0.3, -0.2}, {0.3, -0.2}};
    for (const double radius : {0.5, 1.5}) {
        const CarModel model({{norm(corners[0]), corners}, radius, true, 0.1}, kResolution);
        CarPlanner planner(kSide, kSide, kResolution);
        std::vector<Pose> first;
        for (int k = 0; k < 3; ++k) {
            const long before = allocations.load();
            CHECK(planner.plan(model, {clearance.data(), {0.0, 0.0}}, {1.0, 1.0, 2.0}, {9.0, 9.0}));
            CHECK(allocations.load() == before);
            if (k == 0) first = planner.poses();
            REQUIRE(planner.poses().size() == first.size());
            for (std::size_t i = 0; i < first.size(); ++i) {
                CHECK(planner.poses()[i].x == first[i].x);
                CHECK(planner.poses()[i].y == first[i].y);
            }
        }
        CHECK(first.size() > 10);
    }
}

} // namespace adrl
