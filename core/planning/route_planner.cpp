#include "planning/route_planner.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <numbers>

#include "clones.hpp"
#include "planning/occupancy.hpp"
#include "world/world.hpp"

namespace adrl {
namespace {

// Headings counter-clockwise from the x axis (columns); odd ones are diagonal.
constexpr int kRow[8] = {0, 1, 1, 1, 0, -1, -1, -1};
constexpr int kColumn[8] = {1, 1, 0, -1, -1, -1, 0, 1};
// Metres: a goal that close to a cell that can be reached is not left for the border.
constexpr double kNearEnough = 0.3;
constexpr std::int8_t kSolid = 1; // the least that a solid cell holds

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

// Whether a cell is solid, but no wall.
ADRL_CLONES bool any_may_go(const std::int8_t *log_odds, std::int8_t wall, std::size_t count) {
    int any = 0;
    for (std::size_t i = 0; i < count; ++i) any |= (log_odds[i] >= kSolid) & (log_odds[i] < wall);
    return any != 0;
}

// Distance along the column to the nearest cell that holds `solid` or more, at most limit; rows side by side.
ADRL_CLONES void scan_columns(const std::int8_t *log_odds, std::int8_t solid, int height, int width, int limit,
                              std::uint8_t *column) {
    const auto far = static_cast<std::uint8_t>(limit);
    for (int y = 0; y < height; ++y) {
        const std::int8_t *cells = log_odds + static_cast<std::ptrdiff_t>(y) * width;
        std::uint8_t *here = column + static_cast<std::ptrdiff_t>(y) * width;
        const std::uint8_t *above = y > 0 ? here - width : nullptr;
        for (int x = 0; x < width; ++x) {
            const auto next = static_cast<std::uint8_t>(above ? above[x] + 1 : far);
            const std::uint8_t capped = next < far ? next : far;
            here[x] = cells[x] >= solid ? std::uint8_t{0} : capped;
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
    level();
    density_of_.push_back(1.0); // blocked
    for (int level = 1; level < 256; ++level) density_of_.push_back((level - 1) / 254.0);
    for (const double density : density_of_) price_of_.push_back(costs.k_obstacle * density);
    const double eighth = 0.25 * std::numbers::pi * costs.turn / resolution * kUnit;
    const double curved = 0.25 * costs.weight * costs.k_turn * kUnit;
    turn_straight_ = static_cast<std::uint32_t>(std::lround(eighth + curved));
    turn_diagonal_ = static_cast<std::uint32_t>(std::lround(eighth + curved * std::numbers::sqrt2));
    column_.resize(cells);
    clearance2_.resize(cells);
    level_.assign(padded, 0);
    runs_.reserve(cells / 2 + height);
    first_run_.resize(height + 1);
    moves_.resize(padded);
    cost_.resize(padded);
    estimate_.resize(padded);
    g_.resize(costs.headings ? 8 * padded : padded);
    came_by_.resize(g_.size());
    if (costs.headings) {
        least_g_.resize(padded);
        least_heading_.resize(padded);
    }
    cells_.reserve(cells);
    to_go_.reserve(cells);
    for (int m = 0; m < 8; ++m) offset_[m] = kRow[m] * stride_ + kColumn[m];
}

void RoutePlanner::use(const RouteCosts &costs) {
    if (costs.inflation == costs_.inflation && costs.comfort == costs_.comfort) return;
    costs_.inflation = costs.inflation;
    costs_.comfort = costs.comfort;
    limit_ = limit_cells(costs, resolution_);
    level();
}

// What each clearance is worth.
void RoutePlanner::level() {
    // The tolerance lets a cell pass whose clearance is the inflation but for rounding.
    const double needed = costs_.inflation / resolution_ - 1e-6;
    const double comfort = std::max(costs_.comfort / resolution_, 1e-9);
    level_of_.clear();
    for (int d2 = 0; d2 <= limit_ * limit_; ++d2) {
        const double spare = (std::sqrt(d2) - costs_.inflation / resolution_) / comfort;
        const double density = std::clamp(1.0 - spare, 0.0, 1.0);
        level_of_.push_back(std::sqrt(d2) >= needed && d2 > 0
                                ? static_cast<std::uint8_t>(1 + std::lround(254.0 * density))
                                : std::uint8_t{0});
    }
    row_.assign(static_cast<std::size_t>(width_) + 2 * limit_, static_cast<std::uint16_t>(limit_ * limit_));
}

bool RoutePlanner::survey(const std::int8_t *log_odds, std::int8_t solid, Cell start, Cell goal) {
    measure(log_odds, solid);
    free_around(start);
    return aim(start, goal);
}

void RoutePlanner::measure(const std::int8_t *log_odds, std::int8_t solid) {
    scan_columns(log_odds, solid, height_, width_, limit_, column_.data());
    for (int y = 0; y < height_; ++y) {
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * width_;
        scan_row(column_.data() + row, width_, limit_, row_.data(), clearance2_.data() + row);
        std::uint8_t *level = level_.data() + index(y, 0);
        for (int x = 0; x < width_; ++x) level[x] = level_of_[clearance2_[row + x]];
    }
}

void RoutePlanner::clearances(float *out) const {
    const int far = limit_ * limit_;
    for (std::size_t i = 0; i < clearance2_.size(); ++i) {
        const int squared = clearance2_[i];
        out[i] = squared == far ? static_cast<float>(kFarAway)
                                : static_cast<float>(resolution_ * std::sqrt(static_cast<double>(squared)));
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
bool RoutePlanner::aim(Cell start, Cell goal) {
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
            // The border ends the last run of a row.
            x = static_cast<int>(static_cast<const std::uint8_t *>(std::memchr(level + x, 0, width_ + 1 - x)) - level);
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
    const auto squared = [&](int row, int column) {
        const std::int64_t rows = row - goal.row;
        const std::int64_t columns = column - goal.column;
        return rows * rows + columns * columns;
    };
    std::int64_t least = squared(start.row, start.column);
    for (int k = 0; k < static_cast<int>(runs_.size()); ++k) {
        const Run &run = runs_[k];
        if (root(k) != joined) continue;
        joins_border |= run.row == 0 || run.row == height_ - 1 || run.first == 0 || run.last == width_ - 1;
        const int column = std::clamp(goal.column, run.first, run.last);
        const std::int64_t away = squared(run.row, column);
        if (away >= least) continue;
        least = away;
        target_ = {run.row, column};
    }
    // A goal outside, or shut off within the window: the way there may lie beyond it.
    const bool near = in_window(goal) && std::sqrt(least) * resolution_ <= kNearEnough;
    leaves_ = joins_border && !near;
    if (leaves_) target_ = goal;
    return leaves_ || near;
}

double RoutePlanner::obstacle_density(int row, int column) const { return density_of_[level_[index(row, column)]]; }

Route RoutePlanner::plan(const std::int8_t *log_odds, std::int8_t wall, Cell start, Cell goal, double heading) {
    bool through = false;
    if (!survey(log_odds, kSolid, start, goal) && any_may_go(log_odds, wall, clearance2_.size())) {
        through = survey(log_odds, wall, start, goal);
        if (!through) survey(log_odds, kSolid, start, goal); // walls do it: as it was
    }
    cells_.clear();
    to_go_.clear();
    const std::size_t from = index(start.row, start.column);
    target_cell_ = leaves_ ? 0 : index(target_.row, target_.column);
    prepare(start.row);
    first_row_ = last_row_ = start.row;
    std::uint32_t cost = 0;
    if (is_end(from)) {
        cells_.push_back(start);
        to_go_.push_back(0.0);
    } else if (costs_.headings) {
        cost = search_headings(from, heading);
        trace_headings(from);
    } else {
        cost = search(from);
        trace(from);
    }
    const Cell last = cells_.back();
    return {&cells_, cost * resolution_ / kUnit, last.row == goal.row && last.column == goal.column, through};
}

} // namespace adrl
