#include "control/near_obstacles.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {
namespace {

struct SolidCells { // of a bitmap or a window; nothing is solid outside
    int height, width;
    const std::uint8_t *solid;   // either this
    const std::int8_t *log_odds; // or that
    bool operator()(int row, int column) const {
        if (row < 0 || column < 0 || row >= height || column >= width) return false;
        const auto i = static_cast<std::size_t>(row) * width + column;
        return solid != nullptr ? solid[i] != 0 : log_odds[i] > 0;
    }
};

} // namespace

bool NearObstacles::add(Vec2 a, Vec2 b, double r) {
    if (count_ == kMax - kMaxDiscs) return false; // moving discs join them later
    const Vec2 e = b - a;
    ax[count_] = static_cast<float>(a.x);
    ay[count_] = static_cast<float>(a.y);
    ex[count_] = static_cast<float>(e.x);
    ey[count_] = static_cast<float>(e.y);
    inverse[count_] = static_cast<float>(1.0 / (dot(e, e) + 1e-12));
    radius[count_] = static_cast<float>(r);
    ++count_;
    return true;
}

// The outline of solid cells, as far as it lies within reach: borders between a solid and a free cell, joined along
// rows and columns. lattice: pose of the corner of cell (0, 0).
template <class Solid>
bool NearObstacles::outline(const Solid &solid, const Pose &lattice, double cell, double reach) {
    const double c = std::cos(lattice.theta), s = std::sin(lattice.theta);
    const Vec2 d = robot_ - Vec2{lattice.x, lattice.y};
    const Vec2 at{(c * d.x + s * d.y) / cell, (c * d.y - s * d.x) / cell};
    const double cells = reach / cell;
    const int x0 = std::max(0, static_cast<int>(std::floor(at.x - cells)));
    const int x1 = std::min(solid.width - 1, static_cast<int>(std::floor(at.x + cells)));
    const int y0 = std::max(0, static_cast<int>(std::floor(at.y - cells)));
    const int y1 = std::min(solid.height - 1, static_cast<int>(std::floor(at.y + cells)));
    const auto place = [&](double x, double y) {
        const Vec2 p{cell * (x - at.x), cell * (y - at.y)};
        return Vec2{c * p.x - s * p.y, s * p.x + c * p.y};
    };
    // Along one line of borders; border(k) tells whether there is one, from(k) and to(k) are its ends.
    const auto join = [&](int first, int last, const auto &border, const auto &end) {
        int begin = first;
        for (int k = first; k <= last + 1; ++k) {
            if (k <= last && border(k)) continue;
            if (k > begin) {
                const Vec2 a = end(begin), b = end(k);
                if (origin_to_segment(a, b) <= reach && !add(a, b, 0.0)) return false;
            }
            begin = k + 1;
        }
        return true;
    };
    for (int y = y0; y <= y1 + 1; ++y) {
        const auto border = [&](int x) { return solid(y - 1, x) != solid(y, x); };
        if (!join(x0, x1, border, [&](int x) { return place(x, y); })) return false;
    }
    for (int x = x0; x <= x1 + 1; ++x) {
        const auto border = [&](int y) { return solid(y, x - 1) != solid(y, x); };
        if (!join(y0, y1, border, [&](int y) { return place(x, y); })) return false;
    }
    return true;
}

bool NearObstacles::gather_within(const World &world, double reach) {
    count_ = 0;
    const Circles &circles = world.circles();
    for (int i = 0; i < circles.count; ++i) {
        const Vec2 p = Vec2{circles.x[i], circles.y[i]} - robot_;
        const double far = reach + circles.radius[i];
        if (dot(p, p) <= far * far && !add(p, p, circles.radius[i])) return false;
    }
    for (const Segments *segments : {&world.walls(), &world.edges()}) {
        for (int i = 0; i < segments->count; ++i) {
            const Vec2 a = Vec2{segments->ax[i], segments->ay[i]} - robot_;
            const Vec2 b = Vec2{segments->bx[i], segments->by[i]} - robot_;
            // A quick look at the bounding box first.
            if (std::min(a.x, b.x) > reach || std::max(a.x, b.x) < -reach || std::min(a.y, b.y) > reach ||
                std::max(a.y, b.y) < -reach || origin_to_segment(a, b) > reach) {
                continue;
            }
            if (!add(a, b, 0.0)) return false;
        }
    }
    const Bitmap &bitmap = world.bitmap();
    return bitmap.empty() || outline(SolidCells{bitmap.height, bitmap.width, bitmap.solid.data(), nullptr},
                                     bitmap.origin, bitmap.resolution, reach);
}

void NearObstacles::gather(const Moving &moving, const Pose &pose, double reach, double time_s, bool foresee) {
    robot_ = {pose.x, pose.y};
    moving_ = moving;
    time_s_ = time_s;
    while (!gather_within(moving.world(), reach) && reach > 0.05) reach *= 0.8;
    if (foresee) return;
    count_ = place_discs(0.0);
    moving_.reset();
}

void NearObstacles::gather(const std::int8_t *log_odds, const WindowShape &shape, const WindowOrigin &origin,
                           const Pose &pose, double reach) {
    robot_ = {pose.x, pose.y};
    moving_.reset();
    const SolidCells solid{shape.height, shape.width, nullptr, log_odds};
    const Pose lattice{static_cast<double>(origin.column) * shape.resolution,
                       static_cast<double>(origin.row) * shape.resolution, 0.0};
    for (bool all = false; !all && reach > 0.05; reach *= 0.8) {
        count_ = 0;
        all = outline(solid, lattice, shape.resolution, reach);
    }
}

int NearObstacles::place_discs(double after_s) {
    if (!moving_) return count_;
    int all = count_;
    const DiscPlaces discs = moving_->at(time_s_ + after_s);
    for (int k = 0; k < discs.count; ++k) {
        const Vec2 p = Vec2{discs.x[k], discs.y[k]} - robot_;
        ax[all] = static_cast<float>(p.x);
        ay[all] = static_cast<float>(p.y);
        ex[all] = ey[all] = inverse[all] = 0.0F;
        radius[all++] = static_cast<float>(discs.radius[k]);
    }
    return all;
}

double NearObstacles::clearance(const Footprint &footprint, const Pose &at, double limit, double after_s) {
    const int all = place_discs(after_s);
    const double c = std::cos(at.theta), s = std::sin(at.theta);
    double least = limit;
    for (int k = 0; k < all; ++k) {
        const Vec2 a = Vec2{ax[k], ay[k]} - Vec2{at.x, at.y};
        const Vec2 b = a + Vec2{ex[k], ey[k]};
        if (origin_to_segment(a, b) - radius[k] - footprint.radius >= least) continue;
        const auto turned = [&](Vec2 p) { return Vec2{c * p.x + s * p.y, c * p.y - s * p.x}; };
        least = std::min(least, distance_to_segment(footprint, turned(a), turned(b)) - radius[k]);
    }
    return least;
}

bool NearObstacles::corridor_free(Vec2 from, Vec2 to, double width) const {
    for (int k = 0; k < count_; ++k) {
        const Vec2 a{ax[k], ay[k]};
        const Vec2 b = a + Vec2{ex[k], ey[k]};
        if (segment_to_segment(from, to, a, b) <= width + radius[k]) return false;
    }
    return true;
}

} // namespace adrl
