// Counter-based random numbers: functions of key and counter, even, independent, nearly normal.
#include <bit>
#include <cmath>
#include <set>

#include <doctest/doctest.h>

#include "random.hpp"

namespace adrl {

TEST_CASE("mix64 is SplitMix64's output function") {
    // The first outputs of SplitMix64 seeded with 0: its state grows by the golden gamma, which mix64 adds itself.
    CHECK(mix64(0x0ULL) == 0xE220A8397B1DCDAFULL);
    CHECK(mix64(0x9E3779B97F4A7C15ULL) == 0x6E789E6AA1B965F4ULL);
    CHECK(mix64(2 * 0x9E3779B97F4A7C15ULL) == 0x06C45D188009454FULL);
}

TEST_CASE("no two counters collide, neighbouring seeds and steps included") {
    std::set<std::uint64_t> seen;
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
        for (std::uint64_t step = 0; step < 20; ++step) {
            for (std::uint64_t i = 0; i < 50; ++i) seen.insert(mix64(random_key(seed, step) + i));
        }
    }
    CHECK(seen.size() == 20 * 20 * 50);
}

TEST_CASE("seed and step are not interchangeable") {
    int same = 0;
    for (std::uint64_t a = 0; a < 30; ++a) {
        for (std::uint64_t b = 0; b < a; ++b) same += random_key(a, b) == random_key(b, a);
    }
    CHECK(same == 0);
}

TEST_CASE("a changed bit changes half of the bits") {
    double flipped = 0.0;
    for (std::uint64_t x = 0; x < 500; ++x) {
        for (int bit = 0; bit < 64; ++bit) flipped += std::popcount(mix64(x) ^ mix64(x ^ (1ULL << bit)));
    }
    CHECK(flipped / (500 * 64) == doctest::Approx(32.0).epsilon(0.01));
}

TEST_CASE("uniform01 lies in [0, 1) and is even") {
    CHECK(uniform01(0) == 0.0);
    CHECK(uniform01(~0ULL) < 1.0);
    int bins[10] = {};
    constexpr int kDraws = 100000;
    for (int i = 0; i < kDraws; ++i) ++bins[static_cast<int>(10.0 * uniform01(mix64(i)))];
    for (const int count : bins) CHECK(std::abs(count - kDraws / 10) < 4.0 * std::sqrt(kDraws * 0.09));
}

TEST_CASE("nearly_normal has mean 0, variance 1 and a normal's middle, and is bounded") {
    constexpr int kDraws = 400000;
    double sum = 0.0;
    double squares = 0.0;
    double cubes = 0.0;
    int within = 0;
    for (int i = 0; i < kDraws; ++i) {
        const double x = nearly_normal(mix64(i));
        sum += x;
        squares += x * x;
        cubes += x * x * x;
        within += std::abs(x) < 1.0;
    }
    CHECK(std::abs(sum / kDraws) < 4.0 / std::sqrt(kDraws));
    CHECK(squares / kDraws == doctest::Approx(1.0).epsilon(0.01));
    CHECK(std::abs(cubes / kDraws) < 0.02);
    CHECK(static_cast<double>(within) / kDraws == doctest::Approx(0.683).epsilon(0.03));
    CHECK(nearly_normal(0) == -nearly_normal(~0ULL));
    CHECK(nearly_normal(~0ULL) < 3.47);
    CHECK(nearly_normal(~0ULL) > 3.46);
}

} // namespace adrl
