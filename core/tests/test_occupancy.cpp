// The window of log-odds: moving it keeps what was seen where it was, and a scan fills and clears cells.
#include <numbers>
#include <vector>

#include <doctest/doctest.h>

#include "planning/occupancy.hpp"
#include "random.hpp"

namespace adrl {
namespace {

constexpr WindowShape kShape{64, 48, 0.1};

struct Window {
    std::vector<std::int8_t> cells = std::vector<std::int8_t>(static_cast<std::size_t>(kShape.height) * kShape.width);
    WindowOrigin origin;

    explicit Window(Vec2 robot) { clear_window(cells.data(), kShape, origin, robot); }
    // Of a lattice cell; 0 off the window.
    int at(std::int64_t row, std::int64_t column) const {
        const std::int64_t r = row - origin.row;
        const std::int64_t c = column - origin.column;
        if (r < 0 || c < 0 || r >= kShape.height || c >= kShape.width) return 0;
        return cells[static_cast<std::size_t>(r * kShape.width + c)];
    }
};

} // namespace

TEST_CASE("a window that follows its robot keeps each cell at its place") {
    Window window({0.03, -0.07});
    const double way[][2] = {{2.0, 0.3}, {1.4, -3.0}, {-2.2, -3.1}, {-2.0, 0.0}, {40.0, 9.0}};
    int moved = 0;
    for (const auto &[x, y] : way) {
        for (std::size_t i = 0; i < window.cells.size(); ++i) {
            window.cells[i] =
                static_cast<std::int8_t>(1 + static_cast<int>(100.0 * uniform01(mix64(random_key(1, i)))));
        }
        const Window before = window;
        follow_robot(window.cells.data(), kShape, window.origin, {x, y});
        moved += before.origin.row != window.origin.row || before.origin.column != window.origin.column;
        bool kept = true;
        for (int r = 0; r < kShape.height; ++r) {
            for (int c = 0; c < kShape.width; ++c) {
                const std::int64_t row = window.origin.row + r;
                const std::int64_t column = window.origin.column + c;
                kept = kept && window.at(row, column) == before.at(row, column); // cells that come in are unknown
            }
        }
        CHECK(kept);
        const double row = y / kShape.resolution - static_cast<double>(window.origin.row);
        const double column = x / kShape.resolution - static_cast<double>(window.origin.column);
        CHECK(row >= kShape.height / 4);
        CHECK(row <= kShape.height - kShape.height / 4);
        CHECK(column >= kShape.width / 4);
        CHECK(column <= kShape.width - kShape.width / 4);
    }
    CHECK(moved >= 4);
}

TEST_CASE("hits make cells solid, the way to them free, and what is seen through is forgotten") {
    const int count = 180;
    const Beams beams(count, -std::numbers::pi, 2.0 * std::numbers::pi / count);
    const Evidence evidence;
    const Scanner scanner(evidence, beams, {0.0, 0.0, 0.0}, 6.0, 6.0, 0.0);
    ScanIntegrator integrator(kShape, beams.count());
    Window window({0.0, 0.0});
    const Pose robot{0.05, 0.05, 0.0};
    const auto scan = [&](float range, int times) {
        const std::vector<float> ranges(count, range);
        for (int k = 0; k < times; ++k)
            integrator.integrate(scanner, window.cells.data(), window.origin, robot, ranges.data(), k % 2);
    };
    scan(0.95F, 1);
    CHECK(window.at(0, 10) == 2 * evidence.hit); // hit at x = 1.0 m, and half a cell into the obstacle
    CHECK(window.at(0, 15) == 0);                // behind it: never seen
    scan(0.95F, 1);
    CHECK(window.at(0, 10) == evidence.wall());
    CHECK(window.at(0, 5) < 0);
    scan(1.95F, 2 * (evidence.high / evidence.miss + 1));
    CHECK(window.at(0, 10) < 0);
    CHECK(window.at(0, 20) == evidence.wall());
    scan(1.95F, 2 * (-evidence.low / evidence.miss + 1));
    CHECK(window.at(0, 10) == evidence.free());
    scan(0.95F, 10);
    CHECK(window.at(0, 10) == evidence.wall() - 1); // who came to stand there may go
    CHECK(window.at(0, 20) == evidence.wall());
}

TEST_CASE("a cell holds the greatest evidence that is allowed, and no more") {
    const Beams beams(1, 0.0, 0.0);
    const Evidence evidence{126, 126, -63, 63};
    const Scanner scanner(evidence, beams, {0.0, 0.0, 0.0}, 6.0, 6.0, 0.0);
    ScanIntegrator integrator(kShape, beams.count());
    Window window({0.0, 0.0});
    const auto scan = [&](float range) {
        integrator.integrate(scanner, window.cells.data(), window.origin, {0.05, 0.05, 0.0}, &range, 0);
    };
    const auto cell = [&] { return window.at(0, 10); };
    for (int k = 0; k < 3; ++k) {
        scan(0.95F);
        CHECK(cell() == 126);
    }
    for (int k = 0; k < 3; ++k) scan(1.95F);
    CHECK(cell() == -127);
    for (int k = 0; k < 3; ++k) {
        scan(0.95F);
        CHECK(cell() == 125); // once free
    }
}

TEST_CASE("a corridor with a solid cell in it is not free, and one that was never seen is not known") {
    Window window({0.0, 0.0});
    const auto free = [&](double y, bool known) {
        return corridor_seen_free(window.cells.data(), kShape, window.origin, {0.0, y}, {1.5, y}, 0.25, known);
    };
    CHECK(free(0.0, false));
    CHECK_FALSE(free(0.0, true));
    const std::int64_t cell = (0 - window.origin.row) * kShape.width + 10 - window.origin.column;
    window.cells[static_cast<std::size_t>(cell)] = 5; // middle at (1.05, 0.05)
    CHECK_FALSE(free(0.0, false));
    CHECK_FALSE(free(0.25, false));
    CHECK(free(0.35, false));
}

} // namespace adrl
