// A* on a grid with octile moves, and shortening of its paths.
#pragma once

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

// True when the straight line between two points touches no blocked cell; through a corner point it needs both
// cells beside it free.
bool line_of_sight(const std::uint8_t *blocked, int height, int width, GridPoint from, GridPoint to);

// Corners of a path pulled taut: the same ends, straight lines in free cells only, never longer.
std::vector<GridPoint> shorten_path(const std::uint8_t *blocked, int height, int width, const std::vector<Cell> &cells);

} // namespace adrl
