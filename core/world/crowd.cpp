#include "world/crowd.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>

#include "world/world.hpp"

namespace adrl {
namespace {

constexpr double kMostCells = 1e5;

bool is_convex(const WallEdge &before, const WallEdge &edge) {
    return cross(before.b - before.a, edge.b - edge.a) >= 0.0;
}

// Joins edges in a ring: [first, last).
void join_ring(std::vector<WallEdge> &edges, int first, int last) {
    for (int i = first; i < last; ++i) {
        edges[i].before = i == first ? last - 1 : i - 1;
        edges[i].after = i + 1 == last ? first : i + 1;
    }
    for (int i = first; i < last; ++i) edges[i].convex = is_convex(edges[edges[i].before], edges[i]);
}

struct Border { // along one side of solid cells, in corners of cells; solid on the left
    int x0, y0, x1, y1;
};

// Sides of solid cells towards free ones, joined along rows and columns.
std::vector<Border> borders(const Bitmap &bitmap) {
    std::vector<Border> out;
    const auto solid = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < bitmap.width && y < bitmap.height &&
               bitmap.solid[static_cast<std::size_t>(y) * bitmap.width + x] != 0;
    };
    for (int y = 0; y <= bitmap.height; ++y) {
        for (int x = 0; x < bitmap.width;) {
            const bool above = solid(x, y), below = solid(x, y - 1);
            int end = x + 1;
            while (end < bitmap.width && solid(end, y) == above && solid(end, y - 1) == below) ++end;
            if (above && !below) out.push_back({x, y, end, y}); // eastward: solid to the north
            if (!above && below) out.push_back({end, y, x, y});
            x = end;
        }
    }
    for (int x = 0; x <= bitmap.width; ++x) {
        for (int y = 0; y < bitmap.height;) {
            const bool right = solid(x, y), left = solid(x - 1, y);
            int end = y + 1;
            while (end < bitmap.height && solid(x, end) == right && solid(x - 1, end) == left) ++end;
            if (left && !right) out.push_back({x, y, x, end}); // northward: solid to the west
            if (!left && right) out.push_back({x, end, x, y});
            y = end;
        }
    }
    return out;
}

void add_outlines(const Bitmap &bitmap, std::vector<WallEdge> &edges) {
    const std::vector<Border> sides = borders(bitmap);
    const int base = static_cast<int>(edges.size());
    std::multimap<std::pair<int, int>, int> starting;
    for (std::size_t i = 0; i < sides.size(); ++i) {
        const Border &s = sides[i];
        starting.emplace(std::pair{s.x0, s.y0}, static_cast<int>(i));
        WallEdge edge;
        edge.a = bitmap.to_world({static_cast<double>(s.x0), static_cast<double>(s.y0)});
        edge.b = bitmap.to_world({static_cast<double>(s.x1), static_cast<double>(s.y1)});
        edges.push_back(edge);
    }
    for (std::size_t i = 0; i < sides.size(); ++i) {
        const Border &s = sides[i];
        const auto turn = [&](int j) {
            return static_cast<long>(s.x1 - s.x0) * (sides[j].y1 - sides[j].y0) -
                   static_cast<long>(s.y1 - s.y0) * (sides[j].x1 - sides[j].x0);
        };
        // Where two solid cells touch with a corner, the outline goes on along the other: there is no way between.
        const auto [first, last] = starting.equal_range({s.x1, s.y1});
        int next = first->second;
        for (auto it = first; it != last; ++it) next = turn(it->second) < turn(next) ? it->second : next;
        edges[base + i].after = base + next;
        edges[base + next].before = base + static_cast<int>(i);
        edges[base + next].convex = turn(next) >= 0;
    }
}

// Distance from the box [low, high] to the box about an edge.
double box_distance(Vec2 low, Vec2 high, const WallEdge &edge) {
    const double dx = std::max({std::min(edge.a.x, edge.b.x) - high.x, 0.0, low.x - std::max(edge.a.x, edge.b.x)});
    const double dy = std::max({std::min(edge.a.y, edge.b.y) - high.y, 0.0, low.y - std::max(edge.a.y, edge.b.y)});
    return std::sqrt(dx * dx + dy * dy);
}

} // namespace

std::vector<WallEdge> wall_edges(const Segments &polygon_edges, const std::vector<int> &polygon_begin,
                                 const Segments &thin, const Bitmap &bitmap) {
    std::vector<WallEdge> edges;
    const auto add = [&](Vec2 a, Vec2 b) {
        if (norm(b - a) > 1e-9) edges.push_back({a, b});
    };
    for (std::size_t p = 0; p + 1 < polygon_begin.size(); ++p) {
        const int first = static_cast<int>(edges.size());
        for (int i = polygon_begin[p]; i < polygon_begin[p + 1]; ++i) {
            add({polygon_edges.ax[i], polygon_edges.ay[i]}, {polygon_edges.bx[i], polygon_edges.by[i]});
        }
        join_ring(edges, first, static_cast<int>(edges.size()));
    }
    for (int i = 0; i < thin.count; ++i) {
        const int first = static_cast<int>(edges.size());
        add({thin.ax[i], thin.ay[i]}, {thin.bx[i], thin.by[i]});
        add({thin.bx[i], thin.by[i]}, {thin.ax[i], thin.ay[i]});
        join_ring(edges, first, static_cast<int>(edges.size()));
    }
    if (!bitmap.empty()) add_outlines(bitmap, edges);
    return edges;
}

Walls::Walls(std::vector<WallEdge> edges) : edges_(std::move(edges)) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    Vec2 low{kInfinity, kInfinity}, high{-kInfinity, -kInfinity};
    for (const WallEdge &edge : edges_) {
        low = {std::min(low.x, edge.a.x - kReach), std::min(low.y, edge.a.y - kReach)};
        high = {std::max(high.x, edge.a.x + kReach), std::max(high.y, edge.a.y + kReach)};
    }
    if (edges_.empty()) return;
    cell_ = std::max(1.0, std::sqrt((high.x - low.x) * (high.y - low.y) / kMostCells));
    corner_ = low;
    width_ = static_cast<int>(std::ceil((high.x - low.x) / cell_));
    height_ = static_cast<int>(std::ceil((high.y - low.y) / cell_));
    std::vector<std::vector<std::int32_t>> cells(static_cast<std::size_t>(width_) * height_);
    const auto column = [&](double x, int most) {
        return static_cast<int>(std::clamp(std::floor(x / cell_), 0.0, static_cast<double>(most - 1)));
    };
    for (int i = 0; i < count(); ++i) {
        const Vec2 a = edges_[i].a - corner_, b = edges_[i].b - corner_;
        const int x1 = column(std::max(a.x, b.x) + kReach, width_), y1 = column(std::max(a.y, b.y) + kReach, height_);
        for (int y = column(std::min(a.y, b.y) - kReach, height_); y <= y1; ++y) {
            for (int x = column(std::min(a.x, b.x) - kReach, width_); x <= x1; ++x) {
                const Vec2 from = corner_ + cell_ * Vec2{static_cast<double>(x), static_cast<double>(y)};
                if (box_distance(from, from + Vec2{cell_, cell_}, edges_[i]) <= kReach) {
                    cells[static_cast<std::size_t>(y) * width_ + x].push_back(i);
                }
            }
        }
    }
    for (const auto &cell : cells) {
        begin_.push_back(static_cast<std::int32_t>(listed_.size()));
        listed_.insert(listed_.end(), cell.begin(), cell.end());
    }
    begin_.push_back(static_cast<std::int32_t>(listed_.size()));
}

std::span<const std::int32_t> Walls::near(Vec2 p) const {
    const double x = std::floor((p.x - corner_.x) / cell_), y = std::floor((p.y - corner_.y) / cell_);
    if (!(x >= 0.0 && y >= 0.0 && x < width_ && y < height_)) return {};
    const auto cell = static_cast<std::size_t>(y) * width_ + static_cast<std::size_t>(x);
    return {listed_.data() + begin_[cell], listed_.data() + begin_[cell + 1]};
}

} // namespace adrl
