#include "planning/grid.hpp"

#include <algorithm>
#include <cmath>

#include "drive/collision.hpp"

namespace adrl {
namespace {

struct Window { // cells [x0, x1) x [y0, y1)
    int x0, x1, y0, y1;
};

Window window_of(const GridFrame &frame, Vec2 low, Vec2 high, double margin) {
    const auto cell = [&](double value, double origin) { return (value - origin) / frame.resolution; };
    const auto clamp_cell = [](double value, int size) {
        return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(size)));
    };
    return {clamp_cell(std::floor(cell(low.x - margin, frame.origin_x)), frame.width),
            clamp_cell(std::ceil(cell(high.x + margin, frame.origin_x)) + 1, frame.width),
            clamp_cell(std::floor(cell(low.y - margin, frame.origin_y)), frame.height),
            clamp_cell(std::ceil(cell(high.y + margin, frame.origin_y)) + 1, frame.height)};
}

ADRL_CLONES void lower_by_circle(const GridFrame &frame, const Window &window, Vec2 centre, double radius, float *out) {
    for (int y = window.y0; y < window.y1; ++y) {
        const double dy = frame.origin_y + (y + 0.5) * frame.resolution - centre.y;
        float *row = out + static_cast<std::ptrdiff_t>(y) * frame.width;
        for (int x = window.x0; x < window.x1; ++x) {
            const double dx = frame.origin_x + (x + 0.5) * frame.resolution - centre.x;
            const double gap = std::sqrt(dx * dx + dy * dy) - radius;
            const auto d = static_cast<float>(gap > 0.0 ? gap : 0.0);
            row[x] = d < row[x] ? d : row[x];
        }
    }
}

ADRL_CLONES void lower_by_segment(const GridFrame &frame, const Window &window, Vec2 a, Vec2 b, float *out) {
    const Vec2 e = b - a;
    const double inverse = 1.0 / (dot(e, e) + 1e-300);
    for (int y = window.y0; y < window.y1; ++y) {
        const double ay = a.y - (frame.origin_y + (y + 0.5) * frame.resolution);
        float *row = out + static_cast<std::ptrdiff_t>(y) * frame.width;
        for (int x = window.x0; x < window.x1; ++x) {
            const double ax = a.x - (frame.origin_x + (x + 0.5) * frame.resolution);
            double u = -(ax * e.x + ay * e.y) * inverse;
            u = u < 0.0 ? 0.0 : u;
            u = u > 1.0 ? 1.0 : u;
            const double dx = ax + u * e.x;
            const double dy = ay + u * e.y;
            const auto d = static_cast<float>(std::sqrt(dx * dx + dy * dy));
            row[x] = d < row[x] ? d : row[x];
        }
    }
}

// Cells whose centre is inside the convex polygon of edges [begin, end) become 0.
void fill_polygon(const GridFrame &frame, const Segments &edges, int begin, int end, float *out) {
    Vec2 low{kFarAway, kFarAway};
    Vec2 high{-kFarAway, -kFarAway};
    for (int i = begin; i < end; ++i) {
        low = {std::min(low.x, edges.ax[i]), std::min(low.y, edges.ay[i])};
        high = {std::max(high.x, edges.ax[i]), std::max(high.y, edges.ay[i])};
    }
    const Window window = window_of(frame, low, high, 0.0);
    for (int y = window.y0; y < window.y1; ++y) {
        for (int x = window.x0; x < window.x1; ++x) {
            const Vec2 p{frame.origin_x + (x + 0.5) * frame.resolution, frame.origin_y + (y + 0.5) * frame.resolution};
            bool inside = true;
            for (int i = begin; i < end && inside; ++i) {
                inside = cross({edges.ax[i] - p.x, edges.ay[i] - p.y}, {edges.bx[i] - p.x, edges.by[i] - p.y}) >= 0.0;
            }
            if (inside) out[static_cast<std::ptrdiff_t>(y) * frame.width + x] = 0.0F;
        }
    }
}

void lower_by_segments(const GridFrame &frame, const Segments &segments, double limit, float *out) {
    for (int i = 0; i < segments.count; ++i) {
        const Vec2 a{segments.ax[i], segments.ay[i]};
        const Vec2 b{segments.bx[i], segments.by[i]};
        const Vec2 low{std::min(a.x, b.x), std::min(a.y, b.y)};
        const Vec2 high{std::max(a.x, b.x), std::max(a.y, b.y)};
        lower_by_segment(frame, window_of(frame, low, high, limit), a, b, out);
    }
}

void lower_by_bitmap(const GridFrame &frame, const Bitmap &bitmap, double limit, float *out) {
    for (int y = 0; y < frame.height; ++y) {
        for (int x = 0; x < frame.width; ++x) {
            const Vec2 p{frame.origin_x + (x + 0.5) * frame.resolution, frame.origin_y + (y + 0.5) * frame.resolution};
            float &cell = out[static_cast<std::ptrdiff_t>(y) * frame.width + x];
            cell = std::min(cell, static_cast<float>(point_to_bitmap(bitmap, p, limit)));
        }
    }
}

} // namespace

void clearance_field(const World &world, const GridFrame &frame, double limit, float *out) {
    std::fill(out, out + static_cast<std::ptrdiff_t>(frame.width) * frame.height, static_cast<float>(limit));
    const Circles &circles = world.circles();
    for (int i = 0; i < circles.count; ++i) {
        const Vec2 c{circles.x[i], circles.y[i]};
        const Vec2 r{circles.radius[i], circles.radius[i]};
        lower_by_circle(frame, window_of(frame, c - r, c + r, limit), c, circles.radius[i], out);
    }
    lower_by_segments(frame, world.walls(), limit, out);
    lower_by_segments(frame, world.edges(), limit, out);
    const std::vector<int> &begin = world.polygon_begin();
    for (std::size_t p = 0; p + 1 < begin.size(); ++p) fill_polygon(frame, world.edges(), begin[p], begin[p + 1], out);
    if (!world.bitmap().empty()) lower_by_bitmap(frame, world.bitmap(), limit, out);
}

} // namespace adrl
