// The search of RoutePlanner: A* over cells, or over cells and headings.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "clones.hpp"
#include "planning/route_planner.hpp"

namespace adrl {
namespace {

constexpr int kDiagonalUnits = 90; // below 64 sqrt 2: estimates never exceed the cost
constexpr std::uint32_t kNoWay = ~0U;

// sqrt 2, rounded up.
std::uint32_t diagonal(std::uint32_t straight) { return (straight * 1449 + 1023) >> 10; }

int eighths_between(int a, int b) {
    const int d = (a - b) & 7;
    return d > 4 ? 8 - d : d;
}

// moves[x]: bit k for a free move k. A diagonal one needs both of its neighbours free: corners are not cut.
ADRL_CLONES void find_moves(const std::uint8_t *level, int stride, int width, std::uint8_t *moves) {
    const std::uint8_t *next = level + stride;
    const std::uint8_t *last = level - stride;
    for (int x = 0; x < width; ++x) {
        const unsigned east = level[x + 1] != 0;
        const unsigned west = level[x - 1] != 0;
        const unsigned north = next[x] != 0;
        const unsigned south = last[x] != 0;
        const unsigned slants = (east & north & (next[x + 1] != 0)) << 1 | (west & north & (next[x - 1] != 0)) << 3 |
                                (west & south & (last[x - 1] != 0)) << 5 | (east & south & (last[x + 1] != 0)) << 7;
        moves[x] = static_cast<std::uint8_t>(east | north << 2 | west << 4 | south << 6 | slants);
    }
}

struct Prices {
    double weight, k_goal, near, inverse_near;
    const double *of_level; // k_obstacle O
};

// cost[x], of entering a cell, and estimate[x], of the way from it to the target, `rows` and |x - column| cells away.
//
// The estimate is the integral of the least cost a metre on a way to the goal: 1 + weight k_goal (1 - T_goal). T_goal
// is taken one move nearer, as a move pays for the cell that it enters; so the estimate never exceeds a move and what
// follows it.
ADRL_CLONES void price_row(const Prices &p, const std::uint8_t *level, int width, int rows, int column,
                           std::uint16_t *cost, std::uint32_t *estimate) {
    constexpr int kUnit = RoutePlanner::kUnit;
    for (int x = 0; x < width; ++x) {
        const int columns = std::abs(x - column);
        const int less = std::min(rows, columns);
        const int octile = kUnit * (std::max(rows, columns) - less) + kDiagonalUnits * less;
        const double reach = std::max(0.0, static_cast<double>(octile - kDiagonalUnits));
        const double far = reach < p.near ? 0.5 * reach * reach * p.inverse_near : reach - 0.5 * p.near;
        estimate[x] = static_cast<std::uint32_t>(octile + p.weight * p.k_goal * far);
        const double density = p.of_level[level[x]] + p.k_goal * std::min(octile * p.inverse_near, 1.0);
        const double units = kUnit * (1.0 + p.weight * density);
        const int whole = static_cast<int>(units);
        cost[x] = static_cast<std::uint16_t>(whole < units ? whole + 1 : whole);
    }
}

} // namespace

// What the search needs to know of a row, all cells at once.
void RoutePlanner::prepare(int row) {
    const std::size_t first = index(row, 0);
    const auto ways = costs_.headings ? 8 : 1;
    find_moves(level_.data() + first, stride_, width_, moves_.data() + first);
    price_row({costs_.weight, costs_.k_goal, near_, inverse_near_, price_of_.data()}, level_.data() + first, width_,
              std::abs(row - target_.row), target_.column, cost_.data() + first, estimate_.data() + first);
    std::fill_n(g_.begin() + static_cast<std::ptrdiff_t>(ways * first), ways * width_, kNoWay);
    if (costs_.headings) std::fill_n(least_g_.begin() + static_cast<std::ptrdiff_t>(first), width_, kNoWay);
}

// The search spreads cell by cell, so the rows that are prepared have no gap.
void RoutePlanner::prepare_beside(std::size_t cell) {
    if (cell < index(first_row_ + 1, 0) && first_row_ > 0) prepare(--first_row_);
    if (cell >= index(last_row_, 0) && last_row_ + 1 < height_) prepare(++last_row_);
}

std::uint32_t RoutePlanner::search(std::size_t start) {
    const std::uint32_t least = estimate_[start];
    g_[start] = 0;
    queue_.clear(least);
    queue_.push({least, 0, static_cast<std::uint32_t>(start)});
    QueuedNode at;
    while (queue_.pop(at)) {
        if (at.cost != g_[at.node]) continue;
        if (is_end(at.node)) {
            end_ = at.node;
            return at.cost;
        }
        prepare_beside(at.node);
        // A turn of more than a right angle never pays: what two such moves reach, one reaches for less.
        const int first = at.node == start ? 0 : (came_by_[at.node] + 6) & 7;
        const unsigned within = at.node == start ? 0xff : 0x1f;
        for (unsigned ways = std::rotr(moves_[at.node], first) & within; ways != 0; ways &= ways - 1) {
            const int move = (first + std::countr_zero(ways)) & 7;
            const std::size_t next = at.node + offset_[move];
            const std::uint32_t g = at.cost + (move & 1 ? diagonal(cost_[next]) : cost_[next]);
            if (g >= g_[next]) continue;
            g_[next] = g;
            came_by_[next] = static_cast<std::uint8_t>(move);
            queue_.push({g + estimate_[next], g, static_cast<std::uint32_t>(next)});
        }
    }
    return kNoWay;
}

void RoutePlanner::trace(std::size_t start) {
    for (std::size_t at = end_;; at -= offset_[came_by_[at]]) {
        cells_.push_back(cell_at(at));
        to_go_.push_back((g_[end_] - g_[at]) * resolution_ / kUnit);
        if (at == start) break;
    }
    std::reverse(cells_.begin(), cells_.end());
    std::reverse(to_go_.begin(), to_go_.end());
}

std::uint32_t RoutePlanner::turned_to(std::size_t cell, int heading) const {
    const std::uint32_t g = least_g_[cell];
    return g == kNoWay ? g : g + eighths_between(least_heading_[cell], heading) * turn_diagonal_;
}

// Moves out of a cell that was entered with a heading. Turns of more than a right angle pay only at the start: what two
// moves with such a turn between them reach, one move reaches for less.
void RoutePlanner::expand(std::size_t cell, int heading, std::uint32_t g, bool first) {
    const unsigned within = first ? 0xff : std::rotl(std::uint8_t{0x1f}, heading + 6);
    for (unsigned ways = moves_[cell] & within; ways != 0; ways &= ways - 1) {
        const int move = std::countr_zero(ways);
        const auto turn = static_cast<std::uint32_t>(eighths_between(move, heading));
        const std::size_t next = cell + offset_[move];
        const std::uint32_t reached =
            g + (move & 1 ? diagonal(cost_[next]) + turn * turn_diagonal_ : cost_[next] + turn * turn_straight_);
        // From the cheapest way into the cell it costs no more to turn to this heading.
        if (turned_to(next, move) <= reached || reached >= g_[8 * next + move]) continue;
        g_[8 * next + move] = reached;
        if (reached <= least_g_[next]) { // of equals the last: the queue gives it first
            least_g_[next] = reached;
            least_heading_[next] = static_cast<std::uint8_t>(move);
        }
        came_by_[8 * next + move] = static_cast<std::uint8_t>(heading);
        queue_.push({reached + estimate_[next], reached, static_cast<std::uint32_t>(8 * next + move)});
    }
}

std::uint32_t RoutePlanner::search_headings(std::size_t start, double heading) {
    const int first = static_cast<int>(std::lround(heading / (0.25 * std::numbers::pi))) & 7;
    queue_.clear(estimate_[start]);
    least_g_[start] = 0;
    least_heading_[start] = static_cast<std::uint8_t>(first);
    prepare_beside(start);
    expand(start, first, 0, true);
    QueuedNode at;
    while (queue_.pop(at)) {
        if (at.cost != g_[at.node]) continue;
        const std::size_t cell = at.node / 8;
        const int came = static_cast<int>(at.node % 8);
        if (is_end(cell)) {
            end_ = cell;
            end_heading_ = came;
            return at.cost;
        }
        if (came != least_heading_[cell] && turned_to(cell, came) <= at.cost) continue;
        prepare_beside(cell);
        expand(cell, came, at.cost, false);
    }
    return kNoWay;
}

void RoutePlanner::trace_headings(std::size_t start) {
    const std::uint32_t total = g_[8 * end_ + end_heading_];
    std::size_t at = end_;
    for (int heading = end_heading_; at != start;) {
        cells_.push_back(cell_at(at));
        to_go_.push_back((total - g_[8 * at + heading]) * resolution_ / kUnit);
        const int before = came_by_[8 * at + heading];
        at -= offset_[heading];
        heading = before;
    }
    cells_.push_back(cell_at(start));
    to_go_.push_back(total * resolution_ / kUnit);
    std::reverse(cells_.begin(), cells_.end());
    std::reverse(to_go_.begin(), to_go_.end());
}

} // namespace adrl
