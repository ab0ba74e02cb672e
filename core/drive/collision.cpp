#include "drive/collision.hpp"

#include <algorithm>
#include <cmath>

#include "drive/kinematics.hpp"

namespace adrl {
namespace {

// A robot moves into what it touches when by its own motion it came nearer at kOwnSpeed m/s or more in the last kMoment
// seconds.
constexpr double kMoment = 0.05;
constexpr double kOwnSpeed = 0.05;

struct Lanes { // running minima, a lane each, so that the loops become vector code without reordering
    alignas(64) double value[kLanes];
    explicit Lanes(double start) { std::fill(value, value + kLanes, start); }
    double least() const { return *std::min_element(value, value + kLanes); }
};

ADRL_CLONES void nearest_circle(const double *cx, const double *cy, const double *radius, int count, Vec2 p,
                                Lanes &least) {
    for (int i = 0; i < count; i += kLanes) {
        for (int k = 0; k < kLanes; ++k) {
            const double dx = cx[i + k] - p.x;
            const double dy = cy[i + k] - p.y;
            const double d = std::sqrt(dx * dx + dy * dy) - radius[i + k];
            least.value[k] = d < least.value[k] ? d : least.value[k];
        }
    }
}

ADRL_CLONES void nearest_segment(const Segments &segments, Vec2 p, Lanes &least) {
    const double *sax = segments.ax.data();
    const double *say = segments.ay.data();
    const double *sbx = segments.bx.data();
    const double *sby = segments.by.data();
    for (int i = 0; i < segments.count; i += kLanes) {
        for (int k = 0; k < kLanes; ++k) {
            const double ax = sax[i + k] - p.x;
            const double ay = say[i + k] - p.y;
            const double ex = sbx[i + k] - sax[i + k];
            const double ey = sby[i + k] - say[i + k];
            double u = -(ax * ex + ay * ey) / (ex * ex + ey * ey + 1e-300);
            u = u < 0.0 ? 0.0 : u;
            u = u > 1.0 ? 1.0 : u;
            const double dx = ax + u * ex;
            const double dy = ay + u * ey;
            const double d = std::sqrt(dx * dx + dy * dy);
            least.value[k] = d < least.value[k] ? d : least.value[k];
        }
    }
}

// Distance in cells from p to the square of a cell.
double to_square(Vec2 p, int x, int y) {
    const double dx = std::max({x - p.x, 0.0, p.x - (x + 1)});
    const double dy = std::max({y - p.y, 0.0, p.y - (y + 1)});
    return std::sqrt(dx * dx + dy * dy);
}

// Calls visit(x, y) for every solid cell whose square may lie within `reach` cells of p.
template <class Visit>
void visit_solid(const Bitmap &bitmap, Vec2 p, double reach, Visit visit) {
    const int x0 = std::max(0, static_cast<int>(std::floor(p.x - reach)));
    const int x1 = std::min(bitmap.width - 1, static_cast<int>(std::floor(p.x + reach)));
    const int y0 = std::max(0, static_cast<int>(std::floor(p.y - reach)));
    const int y1 = std::min(bitmap.height - 1, static_cast<int>(std::floor(p.y + reach)));
    for (int y = y0; y <= y1; ++y) {
        const std::uint8_t *jump = bitmap.jump.data() + static_cast<std::size_t>(y) * bitmap.width;
        for (int x = x0; x <= x1;) {
            if (jump[x] == 0) visit(x, y);
            x += std::max<int>(jump[x], 1); // cells nearer than `jump` are free
        }
    }
}

// Lower bound in cells on the distance from p to any solid cell's square, from the distance field.
double bitmap_lower_bound(const Bitmap &bitmap, Vec2 p) {
    const double x = std::floor(p.x);
    const double y = std::floor(p.y);
    if (x < 0 || y < 0 || x >= bitmap.width || y >= bitmap.height) return 0.0;
    // Half a diagonal from p to its cell's centre, and half a diagonal from the solid cell's centre to its square.
    const float centre = bitmap.distance[static_cast<std::size_t>(y) * bitmap.width + static_cast<std::size_t>(x)];
    return static_cast<double>(centre) - 1.4142135623730951;
}

struct Polygon { // a convex polygon on the stack
    Vec2 corner[kMaxCorners];
    int count = 0;
};

Polygon place(const Footprint &footprint, const Pose &pose) {
    Polygon out;
    for (const Vec2 &c : footprint.corners) out.corner[out.count++] = to_world(pose, c);
    return out;
}

bool inside(const Polygon &polygon, Vec2 p) {
    for (int i = 0; i < polygon.count; ++i) {
        const Vec2 a = polygon.corner[i] - p;
        const Vec2 b = polygon.corner[(i + 1) % polygon.count] - p;
        if (cross(a, b) < 0.0) return false;
    }
    return true;
}

// 0 inside.
double to_point(const Polygon &polygon, Vec2 p) {
    if (inside(polygon, p)) return 0.0;
    double least = kFarAway;
    for (int i = 0; i < polygon.count; ++i) {
        least = std::min(least, origin_to_segment(polygon.corner[i] - p, polygon.corner[(i + 1) % polygon.count] - p));
    }
    return least;
}

// 0 when they overlap.
double to_segment(const Polygon &polygon, Vec2 a, Vec2 b) {
    if (inside(polygon, a)) return 0.0;
    double least = kFarAway;
    for (int i = 0; i < polygon.count; ++i) {
        least = std::min(least, segment_to_segment(polygon.corner[i], polygon.corner[(i + 1) % polygon.count], a, b));
    }
    return least;
}

double polygon_to_segments(const Polygon &polygon, const Segments &segments, Vec2 centre, double radius, double least) {
    for (int i = 0; i < segments.count; ++i) {
        const Vec2 a{segments.ax[i], segments.ay[i]};
        const Vec2 b{segments.bx[i], segments.by[i]};
        if (origin_to_segment(a - centre, b - centre) - radius >= least) continue;
        least = std::min(least, to_segment(polygon, a, b));
    }
    return least;
}

double polygon_to_circles(const Polygon &polygon, const double *x, const double *y, const double *r, int count,
                          Vec2 centre, double radius, double least) {
    for (int i = 0; i < count; ++i) {
        const Vec2 c{x[i], y[i]};
        if (norm(c - centre) - r[i] - radius >= least) continue;
        least = std::min(least, to_point(polygon, c) - r[i]);
    }
    return least;
}

double polygon_to_bitmap(const Polygon &polygon, const Bitmap &bitmap, Vec2 centre, double radius, double least) {
    const Vec2 p = bitmap.to_cells(centre);
    const double reach = (least + radius) / bitmap.resolution;
    if (bitmap_lower_bound(bitmap, p) >= reach) return least;
    Polygon in_cells = polygon;
    for (int i = 0; i < polygon.count; ++i) in_cells.corner[i] = bitmap.to_cells(polygon.corner[i]);
    double cells = least / bitmap.resolution;
    visit_solid(bitmap, p, reach, [&](int x, int y) {
        if (to_square(p, x, y) - radius / bitmap.resolution >= cells) return;
        const Vec2 corner[4] = {{x + 0.0, y + 0.0}, {x + 1.0, y + 0.0}, {x + 1.0, y + 1.0}, {x + 0.0, y + 1.0}};
        for (int i = 0; i < 4; ++i) cells = std::min(cells, to_segment(in_cells, corner[i], corner[(i + 1) % 4]));
        if (to_square(in_cells.corner[0], x, y) <= 0.0) cells = 0.0;
    });
    return cells * bitmap.resolution;
}

double disc_clearance(const World &world, const DiscPlaces &discs, double radius, Vec2 p, double limit) {
    Lanes least(limit + radius);
    const Circles &circles = world.circles();
    nearest_circle(circles.x.data(), circles.y.data(), circles.radius.data(), circles.count, p, least);
    nearest_circle(discs.x, discs.y, discs.radius, discs.count, p, least);
    nearest_segment(world.walls(), p, least);
    nearest_segment(world.edges(), p, least);
    double distance = least.least();
    if (inside_polygon(world, p)) distance = std::min(distance, 0.0);
    if (!world.bitmap().empty()) distance = std::min(distance, point_to_bitmap(world.bitmap(), p, limit + radius));
    return distance - radius;
}

double polygon_clearance(const World &world, const DiscPlaces &discs, const Footprint &footprint, const Pose &pose,
                         double limit) {
    const Polygon polygon = place(footprint, pose);
    const Vec2 centre{pose.x, pose.y};
    const double r = footprint.radius;
    const Circles &circles = world.circles();
    double least = polygon_to_circles(polygon, circles.x.data(), circles.y.data(), circles.radius.data(), circles.count,
                                      centre, r, limit);
    least = polygon_to_circles(polygon, discs.x, discs.y, discs.radius, discs.count, centre, r, least);
    least = polygon_to_segments(polygon, world.walls(), centre, r, least);
    least = polygon_to_segments(polygon, world.edges(), centre, r, least);
    // A footprint wholly inside an obstacle touches none of its edges.
    if (inside_polygon(world, polygon.corner[0])) least = std::min(least, 0.0);
    if (!world.bitmap().empty()) least = polygon_to_bitmap(polygon, world.bitmap(), centre, r, least);
    return least;
}

} // namespace

double point_to_bitmap(const Bitmap &bitmap, Vec2 point, double limit) {
    const Vec2 p = bitmap.to_cells(point);
    double least = limit / bitmap.resolution;
    if (bitmap_lower_bound(bitmap, p) >= least) return limit;
    visit_solid(bitmap, p, least, [&](int x, int y) { least = std::min(least, to_square(p, x, y)); });
    return least * bitmap.resolution;
}

double clearance(const World &world, const DiscPlaces &discs, const Footprint &footprint, const Pose &pose,
                 double limit) {
    return footprint.is_disc() ? disc_clearance(world, discs, footprint.radius, {pose.x, pose.y}, limit)
                               : polygon_clearance(world, discs, footprint, pose, limit);
}

double distance_to_point(const Footprint &footprint, Vec2 point) {
    return footprint.is_disc() ? norm(point) - footprint.radius : to_point(place(footprint, {}), point);
}

double distance_to_segment(const Footprint &footprint, Vec2 a, Vec2 b) {
    return footprint.is_disc() ? origin_to_segment(a, b) - footprint.radius : to_segment(place(footprint, {}), a, b);
}

bool corridor_free(const World &world, Vec2 from, Vec2 to, double radius) {
    constexpr double kLeastStep = 0.02; // metres; smaller steps only matter to a line that grazes an obstacle
    const Vec2 line = to - from;
    const double length = norm(line);
    DiscPlaces none; // moving discs do not count
    for (double along = 0.0;;) {
        const Vec2 p = length > 0.0 ? from + (along / length) * line : from;
        const double free = disc_clearance(world, none, radius, p, length + kLeastStep);
        if (free <= 0.0) return false;
        if (along >= length) return true;
        along = std::min(length, along + std::max(free, kLeastStep));
    }
}

Motion drive(const Moving &moving, const Footprint &footprint, const Pose &pose, const Twist &twist, double time_s,
             double dt_s, double start_clearance, double limit) {
    const World &world = moving.world();
    // Turning moves no point of a disc's outline; a polygon's corners sweep at up to |w| r.
    const double sweep = footprint.is_disc() ? 0.0 : std::abs(twist.w) * footprint.radius;
    const double closing = std::abs(twist.v) + sweep + moving.max_speed();
    Motion motion{pose, 0.0, start_clearance, start_clearance <= 0.0, start_clearance};
    double here = start_clearance;
    while (!motion.collided && motion.moved_s < dt_s) {
        const double safe_s = closing > 0.0 ? std::max(here, kContact) / closing : dt_s;
        motion.moved_s = std::min(dt_s, motion.moved_s + safe_s);
        motion.pose = integrate(pose, twist, motion.moved_s);
        here = clearance(world, moving.at(time_s + motion.moved_s), footprint, motion.pose, limit);
        motion.clearance = std::min(motion.clearance, here);
        motion.collided = here <= 0.0;
    }
    motion.final_clearance = here;
    if (motion.collided) {
        const Pose earlier = integrate(motion.pose, {-twist.v, -twist.w}, kMoment);
        const DiscPlaces discs = moving.at(time_s + motion.moved_s);
        motion.at_fault = clearance(world, discs, footprint, earlier, limit) > here + kOwnSpeed * kMoment;
    }
    return motion;
}

} // namespace adrl
