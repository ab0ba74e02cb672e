#include "world/world.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "world/distance_field.hpp"

namespace adrl {
namespace {

void pad_to_lanes(std::vector<double> &values, double filler) {
    while (values.size() % kLanes != 0) values.push_back(filler);
}

// Whether p is inside the polygon whose edges are [begin, end).
bool inside_edges(const Segments &edges, int begin, int end, Vec2 p) {
    for (int i = begin; i < end; ++i) {
        const Vec2 a{edges.ax[i] - p.x, edges.ay[i] - p.y};
        const Vec2 b{edges.bx[i] - p.x, edges.by[i] - p.y};
        if (cross(a, b) < 0.0) return false;
    }
    return true;
}

// Whether any of the boxes around the polygons holds p: rules out nearly all points at once.
ADRL_CLONES bool in_any_box(const Boxes &boxes, Vec2 p) {
    int hits[kLanes] = {};
    for (std::size_t i = 0; i < boxes.x_min.size(); i += kLanes) {
        for (int k = 0; k < kLanes; ++k) {
            hits[k] |= static_cast<int>((p.x >= boxes.x_min[i + k]) & (p.x <= boxes.x_max[i + k]) &
                                        (p.y >= boxes.y_min[i + k]) & (p.y <= boxes.y_max[i + k]));
        }
    }
    return *std::max_element(hits, hits + kLanes) > 0;
}

} // namespace

bool inside_polygon(const World &world, Vec2 p) {
    if (!in_any_box(world.polygon_boxes(), p)) return false;
    const std::vector<int> &begin = world.polygon_begin();
    for (std::size_t i = 0; i + 1 < begin.size(); ++i) {
        if (inside_edges(world.edges(), begin[i], begin[i + 1], p)) return true;
    }
    return false;
}

void Circles::add(double cx, double cy, double r) {
    x.push_back(cx);
    y.push_back(cy);
    radius.push_back(r);
    ++count;
}

void Circles::pad() {
    pad_to_lanes(x, kFarAway);
    pad_to_lanes(y, kFarAway);
    pad_to_lanes(radius, 0.0);
}

void Segments::add(Vec2 a, Vec2 b) {
    ax.push_back(a.x);
    ay.push_back(a.y);
    bx.push_back(b.x);
    by.push_back(b.y);
    ++count;
}

void Segments::pad() {
    for (auto *values : {&ax, &ay, &bx, &by}) pad_to_lanes(*values, kFarAway);
}

Vec2 MovingDisc::at(double time_s) const {
    const double length = norm(to - from);
    if (length <= 0.0) return from;
    const double rounds = phase + speed * std::min(time_s, stop_s) / (2.0 * length);
    const double turn = rounds - std::floor(rounds);
    const double u = turn < 0.5 ? 2.0 * turn : 2.0 - 2.0 * turn;
    return from + u * (to - from);
}

Vec2 MovingDisc::velocity(double time_s) const {
    constexpr double kMoment = 0.1; // seconds
    return (1.0 / kMoment) * (at(time_s + kMoment) - at(time_s));
}

Vec2 Bitmap::to_cells(Vec2 p) const {
    const double dx = p.x - origin.x;
    const double dy = p.y - origin.y;
    return {(cos_theta * dx + sin_theta * dy) / resolution, (cos_theta * dy - sin_theta * dx) / resolution};
}

Vec2 Bitmap::to_world(Vec2 cells) const {
    const double x = cells.x * resolution;
    const double y = cells.y * resolution;
    return {origin.x + cos_theta * x - sin_theta * y, origin.y + sin_theta * x + cos_theta * y};
}

World::World(std::span<const double> circles, std::span<const double> corners, std::span<const std::int32_t> offsets,
             std::span<const double> segments, std::span<const double> discs, const std::uint8_t *solid, int height,
             int width, double resolution, Pose origin) {
    for (std::size_t i = 0; i + 2 < circles.size(); i += 3) circles_.add(circles[i], circles[i + 1], circles[i + 2]);
    for (std::size_t i = 0; i + 3 < segments.size(); i += 4) {
        walls_.add({segments[i], segments[i + 1]}, {segments[i + 2], segments[i + 3]});
    }
    polygon_begin_.push_back(0);
    for (std::size_t p = 0; p + 1 < offsets.size(); ++p) {
        const int first = offsets[p];
        const int size = offsets[p + 1] - first;
        for (int i = 0; i < size; ++i) {
            const int a = first + i;
            const int b = first + (i + 1) % size;
            edges_.add({corners[2 * a], corners[2 * a + 1]}, {corners[2 * b], corners[2 * b + 1]});
        }
        const auto [left, right] = std::minmax_element(edges_.ax.end() - size, edges_.ax.end());
        const auto [low, high] = std::minmax_element(edges_.ay.end() - size, edges_.ay.end());
        polygon_boxes_.x_min.push_back(*left);
        polygon_boxes_.x_max.push_back(*right);
        polygon_boxes_.y_min.push_back(*low);
        polygon_boxes_.y_max.push_back(*high);
        polygon_begin_.push_back(edges_.count);
    }
    for (std::size_t i = 0; i + 7 < discs.size(); i += 8) {
        discs_.push_back({{discs[i], discs[i + 1]},
                          {discs[i + 2], discs[i + 3]},
                          discs[i + 4],
                          discs[i + 5],
                          discs[i + 6],
                          discs[i + 7]});
        max_disc_speed_ = std::max(max_disc_speed_, std::abs(discs[i + 5]));
    }
    if (discs_.size() > kMaxDiscs) throw std::invalid_argument("a world holds at most 64 moving discs");
    circles_.pad();
    walls_.pad();
    edges_.pad();
    for (auto *values : {&polygon_boxes_.x_min, &polygon_boxes_.x_max, &polygon_boxes_.y_min, &polygon_boxes_.y_max}) {
        pad_to_lanes(*values, kFarAway);
    }
    if (height > 0 && width > 0) {
        const auto size = static_cast<std::size_t>(height) * width;
        bitmap_.height = height;
        bitmap_.width = width;
        bitmap_.resolution = resolution;
        bitmap_.origin = origin;
        bitmap_.cos_theta = std::cos(origin.theta);
        bitmap_.sin_theta = std::sin(origin.theta);
        bitmap_.solid.assign(solid, solid + size);
        bitmap_.jump.resize(size);
        bitmap_.distance.resize(size);
        chebyshev_field(solid, height, width, bitmap_.jump.data());
        distance_field(solid, height, width, bitmap_.distance.data());
    }
}

void World::lay_walls() const {
    std::call_once(laid_, [&] { laid_walls_ = Walls(wall_edges(edges_, polygon_begin_, walls_, bitmap_)); });
}

} // namespace adrl
