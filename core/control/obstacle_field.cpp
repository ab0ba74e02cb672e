#include "control/obstacle_field.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {
namespace {

struct Capsule { // in the robot's frame
    float ax, ay, ex, ey, inverse, radius;
};

// Lowers nodes of one row, the first at x, to the distance from a capsule.
ADRL_CLONES void lower_row(float *row, int count, float x, float y, const Capsule &capsule) {
    const float ry = y - capsule.ay;
    for (int i = 0; i < count; ++i) {
        const float rx = x + static_cast<float>(i) * ObstacleField::kSpacing - capsule.ax;
        float u = (rx * capsule.ex + ry * capsule.ey) * capsule.inverse;
        u = u < 0.0F ? 0.0F : u;
        u = u > 1.0F ? 1.0F : u;
        const float dx = rx - u * capsule.ex;
        const float dy = ry - u * capsule.ey;
        const float d = std::sqrt(dx * dx + dy * dy) - capsule.radius;
        row[i] = d < row[i] ? d : row[i];
    }
}

constexpr int kBlock = 64;

struct Block { // points at once: their cells, places in them, and the four nodes about them
    alignas(64) int cell[kBlock];
    alignas(64) float fx[kBlock], fy[kBlock];
    alignas(64) float a[kBlock], b[kBlock], c[kBlock], d[kBlock];
};

ADRL_CLONES void find_cells(Block &block, const float *x, const float *y, int count, int side, float half) {
    const float last = static_cast<float>(side) - 1.001F;
    for (int i = 0; i < count; ++i) {
        float u = (x[i] + half) * (1.0F / ObstacleField::kSpacing);
        float v = (y[i] + half) * (1.0F / ObstacleField::kSpacing);
        u = u < 0.0F ? 0.0F : u;
        v = v < 0.0F ? 0.0F : v;
        u = u > last ? last : u;
        v = v > last ? last : v;
        const int column = static_cast<int>(u);
        const int row = static_cast<int>(v);
        block.fx[i] = u - static_cast<float>(column);
        block.fy[i] = v - static_cast<float>(row);
        block.cell[i] = row * side + column;
    }
}

ADRL_CLONES void interpolate(const Block &block, int count, float *out) {
    for (int i = 0; i < count; ++i) {
        const float low = block.a[i] + block.fx[i] * (block.b[i] - block.a[i]);
        const float high = block.c[i] + block.fx[i] * (block.d[i] - block.c[i]);
        out[i] = low + block.fy[i] * (high - low);
    }
}

} // namespace

// Compilers make no vector code of loops that read where other data says: those loads are a loop of their own.
void ObstacleField::look_up(const float *x, const float *y, int count, float *out) const {
    Block block;
    for (int first = 0; first < count; first += kBlock) {
        const int size = std::min(kBlock, count - first);
        find_cells(block, x + first, y + first, size, side_, half_);
        for (int i = 0; i < size; ++i) {
            const float *p = nodes_.data() + block.cell[i];
            block.a[i] = p[0];
            block.b[i] = p[1];
            block.c[i] = p[side_];
            block.d[i] = p[side_ + 1];
        }
        interpolate(block, size, out + first);
    }
}

void ObstacleField::fill(const NearObstacles &obstacles, double heading, double half_side, double most) {
    side_ = static_cast<int>(side_of(half_side));
    half_ = static_cast<float>(side_ / 2) * kSpacing;
    const auto size = static_cast<std::size_t>(side_) * side_;
    nodes_.resize(size);
    const auto cap = static_cast<float>(most);
    std::fill(nodes_.begin(), nodes_.end(), cap);
    const auto c = static_cast<float>(std::cos(heading));
    const auto s = static_cast<float>(std::sin(heading));
    const auto node = [&](float x) { return (x + half_) / kSpacing; };
    for (int k = 0; k < obstacles.count(); ++k) {
        const float ax = obstacles.ax[k], ay = obstacles.ay[k], ex = obstacles.ex[k], ey = obstacles.ey[k];
        const Capsule turned{c * ax + s * ay, c * ay - s * ax,      c * ex + s * ey,
                             c * ey - s * ex, obstacles.inverse[k], obstacles.radius[k]};
        const float far = cap + turned.radius;
        const float by = turned.ay + turned.ey;
        const auto limit = [&](float value) {
            return static_cast<int>(std::clamp(value, 0.0F, static_cast<float>(side_ - 1)));
        };
        const int y0 = limit(std::floor(node(std::min(turned.ay, by) - far)));
        const int y1 = limit(std::ceil(node(std::max(turned.ay, by) + far)));
        for (int y = y0; y <= y1; ++y) {
            // The part of the segment that is near enough to this row, and what is near enough to that.
            const float row_y = static_cast<float>(y) * kSpacing - half_;
            float from = 0.0F, to = 1.0F;
            if (std::abs(turned.ey) > 1e-6F) {
                const float t0 = (row_y - far - turned.ay) / turned.ey, t1 = (row_y + far - turned.ay) / turned.ey;
                from = std::clamp(std::min(t0, t1), 0.0F, 1.0F);
                to = std::clamp(std::max(t0, t1), 0.0F, 1.0F);
            }
            const float x_from = turned.ax + from * turned.ex, x_to = turned.ax + to * turned.ex;
            const int x0 = limit(std::floor(node(std::min(x_from, x_to) - far)));
            const int x1 = limit(std::ceil(node(std::max(x_from, x_to) + far)));
            lower_row(nodes_.data() + static_cast<std::ptrdiff_t>(y) * side_ + x0, x1 - x0 + 1,
                      static_cast<float>(x0) * kSpacing - half_, row_y, turned);
        }
    }
}

} // namespace adrl
