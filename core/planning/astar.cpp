#include "planning/astar.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>

namespace adrl {
namespace {

constexpr double kDiagonal = std::numbers::sqrt2;

double octile(Cell a, Cell b) {
    const int dr = std::abs(a.row - b.row);
    const int dc = std::abs(a.column - b.column);
    return std::max(dr, dc) - std::min(dr, dc) + kDiagonal * std::min(dr, dc);
}

struct OpenCell {
    double estimate; // cost so far plus octile distance to the goal
    double cost;
    int index;
};

// A heap that yields the least estimate; among equals the deepest cell, which is nearest the goal.
bool later(const OpenCell &a, const OpenCell &b) {
    return a.estimate > b.estimate || (a.estimate == b.estimate && a.cost < b.cost);
}

// Neighbours in the order in which they are looked at. Equal costs are decided by it, and tasks are fixed for ever.
constexpr int kRow[8] = {-1, 1, 0, 0, -1, -1, 1, 1};
constexpr int kColumn[8] = {0, 0, -1, 1, -1, 1, -1, 1};

std::vector<Cell> trace_back(const std::vector<std::int8_t> &came_by, int width, Cell start, Cell goal) {
    std::vector<Cell> cells{goal};
    for (Cell at = goal; at.row != start.row || at.column != start.column;) {
        const int move = came_by[static_cast<std::size_t>(at.row) * width + at.column];
        at = {at.row - kRow[move], at.column - kColumn[move]};
        cells.push_back(at);
    }
    std::reverse(cells.begin(), cells.end());
    return cells;
}

double distance(GridPoint a, GridPoint b) { return std::hypot(a.row - b.row, a.column - b.column); }

// Points along a polyline, its corners included, at most about `count` of them.
std::vector<GridPoint> resample(const std::vector<GridPoint> &corners, int count) {
    double length = 0.0;
    for (std::size_t i = 1; i < corners.size(); ++i) length += distance(corners[i - 1], corners[i]);
    const double spacing = std::max(length / count, 1.0);
    std::vector<GridPoint> points{corners.front()};
    for (std::size_t i = 1; i < corners.size(); ++i) {
        const GridPoint a = corners[i - 1];
        const GridPoint b = corners[i];
        const int pieces = std::max(1, static_cast<int>(distance(a, b) / spacing));
        for (int k = 1; k <= pieces; ++k) {
            const double u = static_cast<double>(k) / pieces;
            points.push_back({a.row + u * (b.row - a.row), a.column + u * (b.column - a.column)});
        }
    }
    points.back() = corners.back();
    return points;
}

// Corners found by walking as far along the points as can be seen from the last corner.
std::vector<GridPoint> farthest_visible(const std::uint8_t *blocked, int height, int width,
                                        const std::vector<GridPoint> &points) {
    std::vector<GridPoint> corners{points.front()};
    for (std::size_t i = 2; i < points.size(); ++i) {
        if (!line_of_sight(blocked, height, width, corners.back(), points[i])) corners.push_back(points[i - 1]);
    }
    corners.push_back(points.back());
    return corners;
}

} // namespace

GridPath astar(const std::uint8_t *blocked, int height, int width, Cell start, Cell goal) {
    const auto index_of = [&](Cell c) { return c.row * width + c.column; };
    const auto is_free = [&](int row, int column) {
        return row >= 0 && column >= 0 && row < height && column < width && !blocked[row * width + column];
    };
    GridPath path{{}, std::numeric_limits<double>::infinity()};
    if (!is_free(start.row, start.column) || !is_free(goal.row, goal.column)) return path;

    const auto size = static_cast<std::size_t>(height) * width;
    std::vector<double> cost(size, std::numeric_limits<double>::infinity());
    std::vector<std::int8_t> came_by(size, -1);
    std::vector<OpenCell> open;
    open.reserve(1024);
    cost[index_of(start)] = 0.0;
    open.push_back({octile(start, goal), 0.0, index_of(start)});
    while (!open.empty()) {
        std::pop_heap(open.begin(), open.end(), later);
        const OpenCell current = open.back();
        open.pop_back();
        if (current.cost > cost[current.index]) continue; // a cheaper way was found meanwhile
        const Cell at{current.index / width, current.index % width};
        if (current.index == index_of(goal)) {
            path.length = current.cost;
            path.cells = trace_back(came_by, width, start, goal);
            return path;
        }
        bool side[4];
        for (int move = 0; move < 8; ++move) {
            const Cell next{at.row + kRow[move], at.column + kColumn[move]};
            const bool free = is_free(next.row, next.column);
            if (move < 4) side[move] = free;
            // Diagonals 4..7 pair (up, left), (up, right), (down, left), (down, right).
            const bool corner_free = move < 4 || (side[(move - 4) / 2] && side[2 + (move - 4) % 2]);
            if (!free || !corner_free) continue;
            const int index = index_of(next);
            const double through = current.cost + (move < 4 ? 1.0 : kDiagonal);
            // The slack keeps rounding of equal costs from reopening cells.
            if (through + 1e-9 >= cost[index]) continue;
            cost[index] = through;
            came_by[index] = static_cast<std::int8_t>(move);
            open.push_back({through + octile(next, goal), through, index});
            std::push_heap(open.begin(), open.end(), later);
        }
    }
    return path;
}

bool line_of_sight(const std::uint8_t *blocked, int height, int width, GridPoint from, GridPoint to) {
    const auto is_free = [&](int row, int column) {
        return row >= 0 && column >= 0 && row < height && column < width && !blocked[row * width + column];
    };
    return straight_free(is_free, from, to);
}

std::vector<GridPoint> shorten_path(const std::uint8_t *blocked, int height, int width,
                                    const std::vector<Cell> &cells) {
    std::vector<GridPoint> path;
    for (const Cell &c : cells) path.push_back({static_cast<double>(c.row), static_cast<double>(c.column)});
    if (path.size() < 3) return path;
    path = farthest_visible(blocked, height, width, path);
    // Each round picks the shortest chain of mutually visible points along the path. Points between the corners let
    // the next round pull it tighter.
    constexpr int kRounds = 3;
    constexpr int kPoints = 48;
    for (int round = 0; round < kRounds; ++round) {
        const std::vector<GridPoint> points = resample(path, kPoints);
        const int count = static_cast<int>(points.size());
        std::vector<double> best(count, std::numeric_limits<double>::infinity());
        std::vector<int> from(count, -1);
        best[0] = 0.0;
        for (int j = 1; j < count; ++j) {
            for (int i = 0; i < j; ++i) {
                const double through = best[i] + distance(points[i], points[j]);
                if (through >= best[j]) continue;
                // Neighbours lie on a line of the path that is already known to be free.
                if (i + 1 < j && !line_of_sight(blocked, height, width, points[i], points[j])) continue;
                best[j] = through;
                from[j] = i;
            }
        }
        path.clear();
        for (int j = count - 1; j >= 0; j = from[j]) path.push_back(points[j]);
        std::reverse(path.begin(), path.end());
    }
    return farthest_visible(blocked, height, width, path); // drops the points between that bend nothing
}

} // namespace adrl
