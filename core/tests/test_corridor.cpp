// Straight corridors against dense sampling of the clearance, and angles.
#include <cmath>
#include <numbers>

#include <doctest/doctest.h>

#include "drive/collision.hpp"
#include "random.hpp"
#include "sim_fixture.hpp"

namespace adrl {
namespace {

// Least clearance of a disc among what stands still, sampled along a line.
double least_clearance(const World &world, Vec2 a, Vec2 b, double radius) {
    const DiscPlaces none{};
    double least = 1e9;
    for (int k = 0; k <= 4000; ++k) {
        const Vec2 p = a + (k / 4000.0) * (b - a);
        least = std::min(least, clearance(world, none, Footprint{radius, {}}, {p.x, p.y, 0.0}, 5.0));
    }
    return least;
}

} // namespace

TEST_CASE("a corridor is free when every place along it is") {
    const auto world = crowded_world();
    int free = 0;
    int decided = 0;
    for (std::uint64_t k = 0; k < 300; ++k) {
        const auto draw = [&](int i) { return 10.0 * uniform01(mix64(random_key(k, i))) - 5.0; };
        const Vec2 a{draw(0), draw(1)};
        const Vec2 b{draw(2), draw(3)};
        const double radius = 0.05 + 0.03 * std::abs(draw(4));
        const double least = least_clearance(*world, a, b, radius);
        // Steps of 2 cm may miss a touch this shallow: half a step's chord, sqrt(r^2 + 0.01^2) - r.
        if (std::abs(least) < 2e-3) continue;
        ++decided;
        free += least > 0.0;
        CHECK(corridor_free(*world, a, b, radius) == (least > 0.0));
    }
    CHECK(decided > 250);
    CHECK(free > 30);
    CHECK(free < decided - 30);
}

TEST_CASE("a corridor of no length is a place") {
    const auto world = crowded_world();
    CHECK(corridor_free(*world, {0.0, 0.0}, {0.0, 0.0}, 0.2));
    CHECK_FALSE(corridor_free(*world, {2.0, 1.0}, {2.0, 1.0}, 0.2));
}

TEST_CASE("wrapped angles lie in (-pi, pi] and point the same way") {
    constexpr double kPi = std::numbers::pi;
    for (double angle = -40.0; angle < 40.0; angle += 0.37) {
        const double wrapped = wrap_angle(angle);
        CHECK(wrapped > -kPi);
        CHECK(wrapped <= kPi);
        CHECK(std::cos(wrapped) == doctest::Approx(std::cos(angle)).epsilon(1e-12));
        CHECK(std::abs(std::sin(wrapped) - std::sin(angle)) < 1e-12);
    }
    CHECK(wrap_angle(-kPi) == kPi);
    CHECK(wrap_angle(kPi) == kPi);
    CHECK(wrap_angle(0.0) == 0.0);
}

} // namespace adrl
