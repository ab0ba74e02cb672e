// A* on a grid with octile moves, and shortening of its paths.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

namespace adrl {

struct Cell {
    int row = 0;
    int column = 0;
};

// A point between cell centres: (0, 0) is the centre of cell (0, 0).
struct GridPoint {
    double row = 0.0;
    double column = 0.0;
};

struct GridPath {
    std::vector<Cell> cells; // start and goal included; empty when there is no path
    double length = 0.0;     // octile length in cells; infinity when there is no path
};

// Shortest 8-connected path through cells that are not blocked. A diagonal move needs both of its neighbours free:
// corners are not cut.
GridPath astar(const std::uint8_t *blocked, int height, int width, Cell start, Cell goal);

// True when the straight line between two points touches only cells with is_free(row, column); through a corner point
// it needs both cells beside it free.
template <class IsFree>
bool straight_free(const IsFree &is_free, GridPoint from, GridPoint to) {
    int row = static_cast<int>(std::floor(from.row + 0.5));
    int column = static_cast<int>(std::floor(from.column + 0.5));
    const int last_row = static_cast<int>(std::floor(to.row + 0.5));
    const int last_column = static_cast<int>(std::floor(to.column + 0.5));
    const double dr = to.row - from.row;
    const double dc = to.column - from.column;
    const int step_row = last_row >= row ? 1 : -1;
    const int step_column = last_column >= column ? 1 : -1;
    if (!is_free(row, column)) return false;
    while (row != last_row || column != last_column) {
        // Fraction of the line at which it leaves the cell through its next row or column border.
        const double to_row = row == last_row ? 2.0 : (row + 0.5 * step_row - from.row) / dr;
        const double to_column = column == last_column ? 2.0 : (column + 0.5 * step_column - from.column) / dc;
        if (std::abs(to_row - to_column) < 1e-9) {
            if (!is_free(row + step_row, column) || !is_free(row, column + step_column)) return false;
            row += step_row;
            column += step_column;
        } else if (to_row < to_column) {
            row += step_row;
        } else {
            column += step_column;
        }
        if (!is_free(row, column)) return false;
    }
    return true;
}

// The same on a bitmap, whose outside is blocked.
bool line_of_sight(const std::uint8_t *blocked, int height, int width, GridPoint from, GridPoint to);

// Corners of a path pulled taut: the same ends, straight lines in free cells only, never longer.
std::vector<GridPoint> shorten_path(const std::uint8_t *blocked, int height, int width, const std::vector<Cell> &cells);

} // namespace adrl
