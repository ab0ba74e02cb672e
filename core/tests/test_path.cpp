// Paths: points at arc lengths, and arc lengths of points.
#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include "planning/path.hpp"

namespace adrl {
namespace {

const std::vector<double> kCorner{0.0, 0.0, 3.0, 0.0, 3.0, 4.0};

void check_point(Vec2 p, double x, double y) {
    CHECK(p.x == doctest::Approx(x));
    CHECK(p.y == doctest::Approx(y));
}

} // namespace

TEST_CASE("length and points along a corner") {
    const Path path(kCorner);
    CHECK(path.length() == doctest::Approx(7.0));
    check_point(path.at(0.0), 0.0, 0.0);
    check_point(path.at(1.5), 1.5, 0.0);
    check_point(path.at(3.0), 3.0, 0.0);
    check_point(path.at(5.0), 3.0, 2.0);
    check_point(path.at(7.0), 3.0, 4.0);
}

TEST_CASE("points beyond the ends are the ends") {
    const Path path(kCorner);
    check_point(path.at(-1.0), 0.0, 0.0);
    check_point(path.at(99.0), 3.0, 4.0);
}

TEST_CASE("a point of the path projects onto itself") {
    const Path path(kCorner);
    for (double s = 0.0; s <= 7.0; s += 0.125) CHECK(path.project(path.at(s), 0.0, 7.0) == doctest::Approx(s));
}

TEST_CASE("the projection is the nearest of densely sampled points") {
    const std::vector<double> points{0.0, 0.0, 2.0, 1.0, 1.0, 3.0, -1.0, 2.5, 0.5, 0.2};
    const Path path(points);
    for (int i = 0; i < 200; ++i) {
        const Vec2 p{3.0 * std::sin(1.7 * i), 3.0 * std::cos(2.3 * i) + 1.0};
        const double from = std::fmod(0.37 * i, path.length());
        const double to = from + 2.0;
        const double found = norm(path.at(path.project(p, from, to)) - p);
        double least = 1e9;
        for (double s = from; s <= std::min(to, path.length()); s += 1e-3)
            least = std::min(least, norm(path.at(s) - p));
        CHECK(found <= least + 1e-12);
        CHECK(found >= least - 2e-3);
    }
}

TEST_CASE("a projection stays in its window") {
    const Path path(kCorner);
    CHECK(path.project({0.0, 0.0}, 2.0, 4.0) == doctest::Approx(2.0));
    CHECK(path.project({3.0, 4.0}, 2.0, 4.0) == doctest::Approx(4.0));
    CHECK(path.project({3.0, 4.0}, 7.0, 9.0) == doctest::Approx(7.0));
}

TEST_CASE("a loop is not cut short: of two places equally near, the window decides") {
    const std::vector<double> there_and_back{0.0, 0.0, 5.0, 0.0, 0.0, 0.0};
    const Path path(there_and_back);
    CHECK(path.project({1.0, 0.1}, 0.0, 3.0) == doctest::Approx(1.0));
    CHECK(path.project({1.0, 0.1}, 6.0, 10.0) == doctest::Approx(9.0));
}

TEST_CASE("paths of one point and of points that coincide") {
    const std::vector<double> one{2.0, 3.0};
    CHECK(Path(one).length() == 0.0);
    check_point(Path(one).at(1.0), 2.0, 3.0);
    CHECK(Path(one).project({9.0, 9.0}, 0.0, 1.0) == 0.0);
    const std::vector<double> twice{0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 2.0};
    const Path path(twice);
    CHECK(path.length() == doctest::Approx(3.0));
    check_point(path.at(1.0), 1.0, 0.0);
    check_point(path.at(2.0), 1.0, 1.0);
    CHECK(path.project({1.5, 1.0}, 0.0, 3.0) == doctest::Approx(2.0));
}

} // namespace adrl
