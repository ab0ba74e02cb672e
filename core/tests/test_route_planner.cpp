// Clearance as far as it is measured at all; routes themselves are tested from Python.
#include <vector>

#include <doctest/doctest.h>

#include "planning/occupancy.hpp"
#include "planning/route_planner.hpp"

namespace adrl {

TEST_CASE("clearance is exact up to the most that is measured, and no farther distance wraps round") {
    constexpr int kSide = 400;
    std::vector<std::int8_t> window(kSide * kSide);
    window[0] = 1;
    for (const double comfort : {5.0, 7.0}) { // 180 and 220 cells of 0.05 m in all: the latter is more than is measured
        CAPTURE(comfort);
        RouteCosts costs;
        costs.inflation = 4.0;
        costs.comfort = comfort;
        RoutePlanner planner(kSide, kSide, 0.05, costs);
        planner.plan(window.data(), Evidence().wall(), {390, 390}, {395, 395}, 0.0);
        const auto density = [&](double away) { return 1.0 - (away - 80.0) / (comfort / 0.05); };
        CHECK_FALSE(planner.is_free(56, 56)); // 79.2 cells from the solid one
        CHECK(planner.is_free(57, 57));       // 80.6
        CHECK(planner.obstacle_density(0, 130) == doctest::Approx(density(130.0)).epsilon(0.01));
        const double least = comfort == 5.0 ? 0.0 : density(RoutePlanner::kMaxReach);
        for (const int row : {185, 300, 399}) {
            for (const int column : {0, 185, 300, 399})
                CHECK(planner.obstacle_density(row, column) == doctest::Approx(least).epsilon(0.01));
        }
    }
}

} // namespace adrl
