// What only C++ sees of grids: the free boxes that rays jump over, and lines of sight.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include <doctest/doctest.h>

#include "planning/astar.hpp"
#include "random.hpp"
#include "world/distance_field.hpp"

namespace adrl {
namespace {

struct Cells {
    int height, width;
    std::vector<std::uint8_t> solid;
    bool at(int row, int column) const { return solid[static_cast<std::size_t>(row) * width + column] != 0; }
};

Cells random_cells(int height, int width, int seed, double density) {
    Cells cells{height, width, std::vector<std::uint8_t>(static_cast<std::size_t>(height) * width)};
    for (std::size_t i = 0; i < cells.solid.size(); ++i) {
        cells.solid[i] = uniform01(mix64(random_key(seed, i))) < density;
    }
    return cells;
}

// Least Chebyshev distance to a solid cell or to a cell beyond the border.
int nearest(const Cells &cells, int row, int column) {
    int least = std::min({row + 1, column + 1, cells.height - row, cells.width - column});
    for (int r = 0; r < cells.height; ++r) {
        for (int c = 0; c < cells.width; ++c) {
            if (cells.at(r, c)) least = std::min(least, std::max(std::abs(r - row), std::abs(c - column)));
        }
    }
    return least;
}

// Whether no sample of the line lies strictly inside a blocked cell.
bool sampled_free(const Cells &cells, GridPoint a, GridPoint b) {
    for (int k = 0; k <= 2000; ++k) {
        const double u = k / 2000.0;
        const double row = a.row + u * (b.row - a.row) + 0.5;
        const double column = a.column + u * (b.column - a.column) + 0.5;
        const double depth = std::min(
            {row - std::floor(row), std::ceil(row) - row, column - std::floor(column), std::ceil(column) - column});
        if (depth > 1e-9 && cells.at(static_cast<int>(row), static_cast<int>(column))) return false;
    }
    return true;
}

GridPoint some_point(const Cells &cells, int seed, int k) {
    const double row = uniform01(mix64(random_key(seed, 2 * k))) * (cells.height - 1);
    const double column = uniform01(mix64(random_key(seed, 2 * k + 1))) * (cells.width - 1);
    // Centres, borders and corners of cells, and anything between.
    const double step = k % 4 == 0 ? 1.0 : (k % 4 == 1 ? 0.5 : 1e-3);
    return {step * std::round(row / step), step * std::round(column / step)};
}

} // namespace

TEST_CASE("a jump is the Chebyshev distance to the nearest solid cell or border") {
    for (int seed = 0; seed < 12; ++seed) {
        const Cells cells = random_cells(3 + 2 * seed, 25 - seed, seed, 0.002 * seed * seed);
        std::vector<std::uint8_t> jump(cells.solid.size());
        chebyshev_field(cells.solid.data(), cells.height, cells.width, jump.data());
        bool same = true;
        for (int r = 0; r < cells.height; ++r) {
            for (int c = 0; c < cells.width; ++c) {
                same = same && jump[static_cast<std::size_t>(r) * cells.width + c] == nearest(cells, r, c);
            }
        }
        CHECK(same);
    }
}

TEST_CASE("jumps end at 255") {
    const Cells cells = random_cells(600, 600, 0, 0.0);
    std::vector<std::uint8_t> jump(cells.solid.size());
    chebyshev_field(cells.solid.data(), cells.height, cells.width, jump.data());
    CHECK(jump[0] == 1);
    CHECK(jump[600 * 300 + 300] == 255);
}

TEST_CASE("a line of sight touches no blocked cell, and a line well clear of all is one") {
    int seen = 0;
    for (int seed = 0; seed < 20; ++seed) {
        const Cells cells = random_cells(14, 17, seed, 0.12);
        for (int k = 0; k < 200; k += 2) {
            const GridPoint a = some_point(cells, seed, k);
            const GridPoint b = some_point(cells, seed, k + 1);
            const bool visible = line_of_sight(cells.solid.data(), cells.height, cells.width, a, b);
            seen += visible;
            if (visible) CHECK(sampled_free(cells, a, b));
        }
    }
    CHECK(seen > 200);
    CHECK(seen < 1800);
}

TEST_CASE("without obstacles everything is in sight") {
    const Cells cells = random_cells(14, 17, 0, 0.0);
    for (int k = 0; k < 200; k += 2) {
        CHECK(line_of_sight(cells.solid.data(), 14, 17, some_point(cells, 5, k), some_point(cells, 5, k + 1)));
    }
}

TEST_CASE("a line through a corner needs both cells beside it free") {
    const std::uint8_t open[4] = {0, 0, 0, 0};
    const std::uint8_t one_side[4] = {0, 1, 0, 0};
    const std::uint8_t other_side[4] = {0, 0, 1, 0};
    CHECK(line_of_sight(open, 2, 2, {0.0, 0.0}, {1.0, 1.0}));
    for (const std::uint8_t *cells : {one_side, other_side}) {
        CHECK_FALSE(line_of_sight(cells, 2, 2, {0.0, 0.0}, {1.0, 1.0}));
        CHECK_FALSE(line_of_sight(cells, 2, 2, {1.0, 1.0}, {0.0, 0.0}));
    }
}

} // namespace adrl
