#include "route_planner.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "clones.hpp"

namespace adrl {
namespace {

// Headings counter-clockwise from the x axis (columns); odd ones are diagonal.
constexpr int kRow[8] = {0, 1, 1, 1, 0, -1, -1, -1};
constexpr int kColumn[8] = {1, 1, 0, -1, -1, -1, 0, 1};
constexpr int kDiagonalUnits = 90; // below 64 sqrt 2: estimates never exceed the cost
constexpr std::uint32_t kNoWay = ~0U;
constexpr double kNearEnough =
    0.3; // metres: a goal that close to a cell that can be reached is not left for the border

// sqrt 2, rounded up.
std::uint32_t diagonal(std::uint32_t straight) { return (straight * 1449 + 1023) >> 10; }

int eighths_between(int a, int b) {
    const int d = (a - b) & 7;
    return d > 4 ? 8 - d : d;
}

int limit_cells(const RouteCosts &costs, double resolution) {
    const double cells = std::ceil((costs.inflation + costs.comfort) / resolution);
    return static_cast<int>(std::clamp(cells, 1.0, static_cast<double>(RoutePlanner::kMaxReach)));
}

std::uint32_t queue_span(const RouteCosts &costs, double resolution) {
    // The longest move and turn, and what its estimate may rise by.
    const double move = RoutePlanner::kUnit * std::numbers::sqrt2 * (2.0 + 2.0 * costs.weight);
    const double turn = std::numbers::pi * costs.turn / resolution * RoutePlanner::kUnit + move;
    return std::bit_ceil(static_cast<std::uint32_t>(move + (costs.headings ? turn : 0.0)) + 16U);
}

// Distance along the column to the nearest solid cell, at most limit; rows side by side.
ADRL_CLONES void scan_columns(const std::int8_t *log_odds, int height, int width, int limit, std::uint8_t *column) {
    const auto far = static_cast<std::uint8_t>(limit);
    for (int y = 0; y < height; ++y) {
        const std::int8_t *cells = log_odds + static_cast<std::ptrdiff_t>(y) * width;
        std::uint8_t *here = column + static_cast<std::ptrdiff_t>(y) * width;
        const std::uint8_t *above = y > 0 ? here - width : nullptr;
        for (int x = 0; x < width; ++x) {
            const auto next = static_cast<std::uint8_t>(above ? above[x] + 1 : far);
            const std::uint8_t capped = next < far ? next : far;
            here[x] = cells[x] > 0 ? std::uint8_t{0} : capped;
        }
    }
    for (int y = height - 2; y >= 0; --y) {
        std::uint8_t *here = column + static_cast<std::ptrdiff_t>(y) * width;
        const std::uint8_t *below = here + width;
        for (int x = 0; x < width; ++x) {
            const auto next = static_cast<std::uint8_t>(below[x] + 1);
            here[x] = here[x] < next ? here[x] : next;
        }
    }
}

// out[x] = min over k of k^2 + column[x + k]^2, |k| < limit, at most limit^2. row: scratch of width + 2 limit.
ADRL_CLONES void scan_row(const std::uint8_t *column, int width, int limit, std::uint16_t *row, std::uint16_t *out) {
    const auto far = static_cast<std::uint16_t>(limit * limit);
    for (int x = 0; x < width; ++x) {
        const auto squared = static_cast<std::uint16_t>(column[x] * column[x]);
        row[limit + x] = squared;
        out[x] = squared;
    }
    for (int k = 1; k < limit; ++k) {
        const auto square = static_cast<std::uint16_t>(k * k);
        const std::uint16_t *left = row + limit - k;
        const std::uint16_t *right = row + limit + k;
        for (int x = 0; x < width; ++x) {
            const std::uint16_t nearer = left[x] < right[x] ? left[x] : right[x];
            const auto through = static_cast<std::uint16_t>(nearer + square);
            out[x] = out[x] < through ? out[x] : through;
        }
    }
    for (int x = 0; x < width; ++x) out[x] = out[x] < far ? out[x] : far;
}

} // namespace

RoutePlanner::RoutePlanner(int height, int width, double resolution, const RouteCosts &costs)
    : height_(height), width_(width), stride_(width + 2), resolution_(resolution), costs_(costs),
      near_(costs.near_goal / resolution * kUnit), inverse_near_(1.0 / near_), limit_(limit_cells(costs, resolution)),
      queue_(queue_span(costs, resolution), static_cast<std::size_t>(height) * width) {
    const auto cells = static_cast<std::size_t>(height) * width;
    const auto padded = static_cast<std::size_t>(height + 2) * stride_;
    // The tolerance lets a cell pass whose clearance is the inflation but for rounding.
    const double needed = costs.inflation / resolution - 1e-6;
    const double comfort = std::max(costs.comfort / resolution, 1e-9);
    for (int d2 = 0; d2 <= limit_ * limit_; ++d2) {
        const double spare = (std::sqrt(d2) - costs.inflation / resolution) / comfort;
        const double density = std::clamp(1.0 - spare, 0.0, 1.0);
        level_of_.push_back(std::sqrt(d2) >= needed && d2 > 0
                                ? static_cast<std::uint8_t>(1 + std::lround(254.0 * density))
                                : std::uint8_t{0});
    }
    density_of_.push_back(1.0); // blocked
    for (int level = 1; level < 256; ++level) density_of_.push_back((level - 1) / 254.0);
    const double eighth = 0.25 * std::numbers::pi * costs.turn / resolution * kUnit;
    const double curved = 0.25 * costs.weight * costs.k_turn * kUnit;
    turn_straight_ = static_cast<std::uint32_t>(std::lround(eighth + curved));
    turn_diagonal_ = static_cast<std::uint32_t>(std::lround(eighth + curved * std::numbers::sqrt2));
    column_.resize(cells);
    row_.assign(static_cast<std::size_t>(width) + 2 * limit_, static_cast<std::uint16_t>(limit_ * limit_));
    clearance2_.resize(cells);
    level_.assign(padded, 0);
    runs_.reserve(cells / 2 + height);
    first_run_.resize(height + 1);
    if (costs.headings) {
        cell_nodes_.resize(padded);
        states_.resize(8 * padded);
    } else {
        nodes_.resize(padded);
        came_by_.resize(padded);
    }
    cells_.reserve(cells);
    to_go_.reserve(cells);
    for (int m = 0; m < 8; ++m) offset_[m] = kRow[m] * stride_ + kColumn[m];
}

void RoutePlanner::measure(const std::int8_t *log_odds) {
    scan_columns(log_odds, height_, width_, limit_, column_.data());
    for (int y = 0; y < height_; ++y) {
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * width_;
        scan_row(column_.data() + row, width_, limit_, row_.data(), clearance2_.data() + row);
        std::uint8_t *level = level_.data() + index(y, 0);
        for (int x = 0; x < width_; ++x) level[x] = level_of_[clearance2_[row + x]];
    }
}

void RoutePlanner::free_around(Cell start) {
    const auto squared = [&](int row, int column) {
        return clearance2_[static_cast<std::size_t>(row) * width_ + column];
    };
    const int has = squared(start.row, start.column);
    const int reach = static_cast<int>(std::ceil(costs_.inflation / resolution_)) + 1;
    for (int row = std::max(0, start.row - reach); row <= std::min(height_ - 1, start.row + reach); ++row) {
        for (int column = std::max(0, start.column - reach); column <= std::min(width_ - 1, start.column + reach);
             ++column) {
            std::uint8_t &level = level_[index(row, column)];
            const int dr = row - start.row;
            const int dc = column - start.column;
            if (level == 0 && dr * dr + dc * dc <= reach * reach && squared(row, column) >= std::max(has, 1)) {
                level = 255;
            }
        }
    }
    std::uint8_t &own = level_[index(start.row, start.column)];
    if (own == 0) own = 255;
}

int RoutePlanner::root(int run) {
    while (runs_[run].parent != run) {
        runs_[run].parent = runs_[runs_[run].parent].parent;
        run = runs_[run].parent;
    }
    return run;
}

// Free cells joined by their sides are runs of rows that overlap: far fewer than cells. A diagonal move needs both its
// neighbours, so what it reaches is joined by sides too.
void RoutePlanner::aim(Cell start, Cell goal) {
    runs_.clear();
    int start_run = 0;
    for (int row = 0; row < height_; ++row) {
        first_run_[row] = static_cast<int>(runs_.size());
        const std::uint8_t *level = level_.data() + index(row, 0);
        int above = row > 0 ? first_run_[row - 1] : 0;
        const int above_end = row > 0 ? first_run_[row] : 0;
        for (int x = 0; x < width_;) {
            while (x < width_ && level[x] == 0) ++x;
            if (x == width_) break;
            const int first = x;
            while (x < width_ && level[x] != 0) ++x; // the border ends the last run of a row
            const int own = static_cast<int>(runs_.size());
            runs_.push_back({row, first, x - 1, own});
            if (row == start.row && first <= start.column && start.column < x) start_run = own;
            while (above < above_end && runs_[above].last < first) ++above;
            for (int k = above; k < above_end && runs_[k].first < x; ++k) runs_[root(k)].parent = root(own);
        }
    }
    const int joined = root(start_run);
    target_ = start;
    bool joins_border = false;
    double least = std::hypot(start.row - goal.row, start.column - goal.column);
    for (int k = 0; k < static_cast<int>(runs_.size()); ++k) {
        const Run &run = runs_[k];
        if (root(k) != joined) continue;
        joins_border |= run.row == 0 || run.row == height_ - 1 || run.first == 0 || run.last == width_ - 1;
        const int column = std::clamp(goal.column, run.first, run.last);
        const double away = std::hypot(run.row - goal.row, column - goal.column);
        if (away >= least) continue;
        least = away;
        target_ = {run.row, column};
    }
    // A goal outside, or shut off within the window: the way there may lie beyond it.
    leaves_ = joins_border && least > 0.0;
    if (leaves_ && !(in_window(goal) && least * resolution_ <= kNearEnough))
        target_ = goal;
    else
        leaves_ = false;
}

std::uint32_t RoutePlanner::octile_units(Cell c) const {
    const int dr = std::abs(c.row - target_.row);
    const int dc = std::abs(c.column - target_.column);
    return static_cast<std::uint32_t>(kUnit * (std::max(dr, dc) - std::min(dr, dc)) +
                                      kDiagonalUnits * std::min(dr, dc));
}

// Integral of the least cost a metre on a way to the goal: 1 + weight k_goal (1 - T_goal). T_goal is taken one move
// nearer, as a move pays for the cell that it enters; so the estimate never exceeds a move and what follows it.
std::uint32_t RoutePlanner::to_goal(std::uint32_t octile) const {
    const double reach = std::max(0.0, static_cast<double>(octile) - kDiagonalUnits);
    const double far_from_goal = reach < near_ ? 0.5 * reach * reach * inverse_near_ : reach - 0.5 * near_;
    return static_cast<std::uint32_t>(octile + costs_.weight * costs_.k_goal * far_from_goal);
}

std::uint16_t RoutePlanner::entering(std::size_t cell, std::uint32_t octile) const {
    const double away = std::min(octile * inverse_near_, 1.0);
    const double density = costs_.k_obstacle * density_of_[level_[cell]] + costs_.k_goal * away;
    const double cost = kUnit * (1.0 + costs_.weight * density);
    const auto whole = static_cast<std::uint16_t>(cost);
    return static_cast<std::uint16_t>(whole < cost ? whole + 1 : whole);
}

double RoutePlanner::obstacle_density(int row, int column) const { return density_of_[level_[index(row, column)]]; }

void RoutePlanner::next_stamp() {
    // Node keeps 16 bits of it, State 24.
    if (++stamp_ >= (1U << 16)) {
        stamp_ = 1;
        for (Node &node : nodes_) node.stamp = 0;
        for (CellNode &node : cell_nodes_) node.stamp = 0;
        for (State &state : states_) state.stamp_from = 0;
    }
}

Route RoutePlanner::plan(const std::int8_t *log_odds, Cell start, Cell goal, double heading) {
    measure(log_odds);
    free_around(start);
    aim(start, goal);
    next_stamp();
    cells_.clear();
    to_go_.clear();
    const std::size_t from = index(start.row, start.column);
    std::uint32_t cost = 0;
    if (is_end(start)) {
        cells_.push_back(start);
        to_go_.push_back(0.0);
    } else if (costs_.headings) {
        cost = search_headings(start, heading);
        trace_headings(from);
    } else {
        cost = search(start);
        trace(from);
    }
    const Cell last = cells_.back();
    return {&cells_, cost * resolution_ / kUnit, last.row == goal.row && last.column == goal.column};
}

RoutePlanner::Node &RoutePlanner::open(std::size_t cell, Cell c) {
    Node &node = nodes_[cell];
    if (node.stamp != stamp_) node = {kNoWay, static_cast<std::uint16_t>(stamp_), entering(cell, octile_units(c))};
    return node;
}

std::uint32_t RoutePlanner::search(Cell start) {
    const auto from = static_cast<std::uint32_t>(index(start.row, start.column));
    const std::uint32_t least = to_goal(octile_units(start));
    open(from, start).g = 0;
    queue_.clear(least);
    queue_.push({least, 0, from});
    QueuedNode at;
    while (queue_.pop(at)) {
        if (at.cost != nodes_[at.node].g) continue;
        const Cell here = cell_at(at.node);
        if (is_end(here)) {
            end_ = at.node;
            return at.cost;
        }
        // A turn of more than a right angle never pays: what two such moves reach, one reaches for less.
        const int first = at.node == from ? 0 : came_by_[at.node] + 6;
        const int last = at.node == from ? 7 : came_by_[at.node] + 10;
        for (int k = first; k <= last; ++k) {
            const int move = k & 7;
            const std::size_t next = at.node + offset_[move];
            if (level_[next] == 0) continue;
            const bool slant = move & 1;
            if (slant && (level_[at.node + offset_[move - 1]] == 0 || level_[at.node + offset_[(move + 1) & 7]] == 0)) {
                continue;
            }
            const Cell there{here.row + kRow[move], here.column + kColumn[move]};
            Node &node = open(next, there);
            const std::uint32_t g = at.cost + (slant ? diagonal(node.cost) : node.cost);
            if (g >= node.g) continue;
            node.g = g;
            came_by_[next] = static_cast<std::uint8_t>(move);
            queue_.push({g + to_goal(octile_units(there)), g, static_cast<std::uint32_t>(next)});
        }
    }
    return kNoWay;
}

void RoutePlanner::trace(std::size_t start) {
    for (std::size_t at = end_;; at -= offset_[came_by_[at]]) {
        cells_.push_back(cell_at(at));
        to_go_.push_back((nodes_[end_].g - nodes_[at].g) * resolution_ / kUnit);
        if (at == start) break;
    }
    std::reverse(cells_.begin(), cells_.end());
    std::reverse(to_go_.begin(), to_go_.end());
}

RoutePlanner::CellNode &RoutePlanner::visit(std::size_t cell, Cell c) {
    CellNode &node = cell_nodes_[cell];
    if (node.stamp != stamp_) {
        const std::uint32_t octile = octile_units(c);
        node = {stamp_, 0, to_goal(octile), entering(cell, octile), 0, false};
    }
    return node;
}

// Moves out of a cell that was entered with a heading. Turns of more than a right angle pay only at the start: what two
// moves with such a turn between them reach, one move reaches for less.
void RoutePlanner::expand(std::size_t cell, int heading, std::uint32_t g, bool first) {
    const int widest = first ? 4 : 2;
    const Cell here = cell_at(cell);
    for (int move = 0; move < 8; ++move) {
        const int turn = eighths_between(move, heading);
        const std::size_t next = cell + offset_[move];
        if (turn > widest || level_[next] == 0) continue;
        const bool slant = move & 1;
        if (slant && (level_[cell + offset_[move - 1]] == 0 || level_[cell + offset_[(move + 1) & 7]] == 0)) continue;
        const CellNode &node = visit(next, {here.row + kRow[move], here.column + kColumn[move]});
        const std::uint32_t reached =
            g + (slant ? diagonal(node.cost) + turn * turn_diagonal_ : node.cost + turn * turn_straight_);
        // From the heading with which the cell was first expanded it costs no more to turn to this one.
        if (node.expanded &&
            reached >= node.expanded_g + eighths_between(node.expanded_heading, move) * turn_diagonal_) {
            continue;
        }
        State &state = states_[8 * next + move];
        if (state.stamp_from >> 8 == stamp_ && reached >= state.g) continue;
        state = {reached, stamp_ << 8 | static_cast<std::uint32_t>(heading)};
        queue_.push({reached + node.estimate, reached, static_cast<std::uint32_t>(8 * next + move)});
    }
}

std::uint32_t RoutePlanner::search_headings(Cell start, double heading) {
    const int first = static_cast<int>(std::lround(heading / (0.25 * std::numbers::pi))) & 7;
    const std::size_t from = index(start.row, start.column);
    CellNode &own = visit(from, start);
    queue_.clear(own.estimate);
    own.expanded = true;
    own.expanded_heading = static_cast<std::uint8_t>(first);
    expand(from, first, 0, true);
    QueuedNode at;
    while (queue_.pop(at)) {
        if (at.cost != states_[at.node].g) continue;
        const std::size_t cell = at.node / 8;
        const int came = static_cast<int>(at.node % 8);
        if (is_end(cell_at(cell))) {
            end_ = cell;
            end_heading_ = came;
            return at.cost;
        }
        CellNode &node = cell_nodes_[cell];
        if (!node.expanded) {
            node.expanded = true;
            node.expanded_g = at.cost;
            node.expanded_heading = static_cast<std::uint8_t>(came);
        } else if (at.cost >= node.expanded_g + eighths_between(node.expanded_heading, came) * turn_diagonal_) {
            continue;
        }
        expand(cell, came, at.cost, false);
    }
    return kNoWay;
}

void RoutePlanner::trace_headings(std::size_t start) {
    const std::uint32_t total = states_[8 * end_ + end_heading_].g;
    std::size_t at = end_;
    for (int heading = end_heading_; at != start;) {
        const State &state = states_[8 * at + heading];
        cells_.push_back(cell_at(at));
        to_go_.push_back((total - state.g) * resolution_ / kUnit);
        at -= offset_[heading];
        heading = static_cast<int>(state.stamp_from & 7);
    }
    cells_.push_back(cell_at(start));
    to_go_.push_back(total * resolution_ / kUnit);
    std::reverse(cells_.begin(), cells_.end());
    std::reverse(to_go_.begin(), to_go_.end());
}

} // namespace adrl
