#include "control/dwa.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace adrl {
namespace {

constexpr int kSpeeds = 7;
constexpr int kYawRates = 17;
constexpr int kLeastSamples = 10; // poses along an arc
constexpr int kMostSamples = 64;
constexpr int kCandidates = 128;
static_assert(kSpeeds * kYawRates <= kCandidates && kCandidates % 16 == 0);
constexpr int kMaxLocal = 256; // obstacles of a kind near the robot; where there are more, it looks less far
constexpr int kMaxCover = 4;
constexpr float kArrived = 0.1F; // metres from the target

// Everything below is in metres relative to the robot's position, axes of the world, in single precision.
struct Local {
    float cx[kMaxLocal], cy[kMaxLocal], cr[kMaxLocal];
    float ax[kMaxLocal], ay[kMaxLocal], ex[kMaxLocal], ey[kMaxLocal], inverse[kMaxLocal];
    int circles = 0;
    int segments = 0;
};

struct Arcs {
    alignas(64) float v[kCandidates], w[kCandidates];
    alignas(64) float x[kCandidates], y[kCandidates];           // position at the current sample
    alignas(64) float hx[kCandidates], hy[kCandidates];         // heading at the current sample
    alignas(64) float turn_c[kCandidates], turn_s[kCandidates]; // rotation over one sample
    alignas(64) float mid_c[kCandidates], mid_s[kCandidates];   // half of it
    alignas(64) float chord[kCandidates];
    alignas(64) float clear[kCandidates]; // clearance at the current sample
    alignas(64) float least[kCandidates]; // least so far
    alignas(64) float hit_s[kCandidates];
    alignas(64) float brake_s[kCandidates]; // time it takes to stop from the arc's speed
    alignas(64) float nearest[kCandidates]; // least distance to the target so far
    alignas(64) float away[kCandidates];    // sum of `nearest` over the samples
};

// Discs along the footprint's longer axis that together cover it.
struct Cover {
    float x[kMaxCover], y[kMaxCover];
    float radius;
    int count;
};

Cover cover_of(const Footprint &footprint) {
    if (footprint.is_disc()) return {{0.0F}, {0.0F}, static_cast<float>(footprint.radius), 1};
    Vec2 low{kFarAway, kFarAway};
    Vec2 high{-kFarAway, -kFarAway};
    for (const Vec2 &c : footprint.corners) {
        low = {std::min(low.x, c.x), std::min(low.y, c.y)};
        high = {std::max(high.x, c.x), std::max(high.y, c.y)};
    }
    const Vec2 size = high - low;
    const bool along_x = size.x >= size.y;
    const double longer = std::max(size.x, size.y);
    const double shorter = std::min(size.x, size.y);
    Cover cover{};
    cover.count = std::clamp(static_cast<int>(std::ceil(longer / shorter)), 2, kMaxCover);
    const double piece = longer / cover.count;
    cover.radius = static_cast<float>(0.5 * std::hypot(piece, shorter));
    for (int i = 0; i < cover.count; ++i) {
        const double along = -0.5 * longer + (i + 0.5) * piece;
        cover.x[i] = static_cast<float>(0.5 * (low.x + high.x) + (along_x ? along : 0.0));
        cover.y[i] = static_cast<float>(0.5 * (low.y + high.y) + (along_x ? 0.0 : along));
    }
    return cover;
}

// False when there are more within reach than fit.
bool gather_segments(const Segments &segments, const Pose &pose, double reach, Local &local) {
    for (int i = 0; i < segments.count; ++i) {
        const Vec2 a{segments.ax[i] - pose.x, segments.ay[i] - pose.y};
        const Vec2 b{segments.bx[i] - pose.x, segments.by[i] - pose.y};
        // A quick look at the bounding box first.
        if (std::min(a.x, b.x) > reach || std::max(a.x, b.x) < -reach || std::min(a.y, b.y) > reach ||
            std::max(a.y, b.y) < -reach || origin_to_segment(a, b) > reach) {
            continue;
        }
        if (local.segments == kMaxLocal) return false;
        const int k = local.segments++;
        const Vec2 e = b - a;
        local.ax[k] = static_cast<float>(a.x);
        local.ay[k] = static_cast<float>(a.y);
        local.ex[k] = static_cast<float>(e.x);
        local.ey[k] = static_cast<float>(e.y);
        local.inverse[k] = static_cast<float>(1.0 / (dot(e, e) + 1e-12));
    }
    return true;
}

bool gather(const World &world, const Pose &pose, double reach, Local &local) {
    const Circles &circles = world.circles();
    local.circles = 0;
    local.segments = 0;
    for (int i = 0; i < circles.count; ++i) {
        const double dx = circles.x[i] - pose.x;
        const double dy = circles.y[i] - pose.y;
        const double far = reach + circles.radius[i];
        if (dx * dx + dy * dy > far * far) continue;
        if (local.circles == kMaxLocal - kMaxDiscs) return false; // moving discs join them later
        const int k = local.circles++;
        local.cx[k] = static_cast<float>(dx);
        local.cy[k] = static_cast<float>(dy);
        local.cr[k] = static_cast<float>(circles.radius[i]);
    }
    return gather_segments(world.walls(), pose, reach, local) && gather_segments(world.edges(), pose, reach, local);
}

void fill_arcs(Arcs &arcs, const DriveLimits &limits, const Pose &pose, const Twist &twist, double dt_s,
               double sample_s, float target_distance, bool sweeps) {
    const double v_low =
        std::max(limits.min_speed, std::min(twist.v - limits.max_acceleration * dt_s, limits.max_speed));
    const double v_high =
        std::min(limits.max_speed, std::max(twist.v + limits.max_acceleration * dt_s, limits.min_speed));
    const double w_low =
        std::max(-limits.max_yaw_rate, std::min(twist.w - limits.max_yaw_acceleration * dt_s, limits.max_yaw_rate));
    const double w_high =
        std::min(limits.max_yaw_rate, std::max(twist.w + limits.max_yaw_acceleration * dt_s, -limits.max_yaw_rate));
    int k = 0;
    for (int j = 0; j < kYawRates; ++j) {
        double w = w_low + (w_high - w_low) * j / (kYawRates - 1);
        if (j == kYawRates / 2 && w_low < 0.0 && w_high > 0.0) w = 0.0; // straight on is always among them
        const double half = 0.5 * w * sample_s;
        const double sinc = std::abs(half) < 1e-4 ? 1.0 : std::sin(half) / half;
        for (int i = 0; i < kSpeeds; ++i, ++k) {
            double v = v_low + (v_high - v_low) * i / (kSpeeds - 1);
            // So is standing still, where the window holds it.
            if (v_low < 0.0 && v_high > 0.0 && std::abs(v) <= 0.5 * (v_high - v_low) / (kSpeeds - 1)) v = 0.0;
            arcs.v[k] = static_cast<float>(v);
            arcs.w[k] = static_cast<float>(w);
            arcs.turn_c[k] = static_cast<float>(std::cos(2.0 * half));
            arcs.turn_s[k] = static_cast<float>(std::sin(2.0 * half));
            arcs.mid_c[k] = static_cast<float>(std::cos(half));
            arcs.mid_s[k] = static_cast<float>(std::sin(half));
            arcs.chord[k] = static_cast<float>(v * sample_s * sinc);
        }
    }
    for (; k < kCandidates; ++k) { // unused lanes repeat the last arc
        arcs.v[k] = arcs.v[k - 1];
        arcs.w[k] = arcs.w[k - 1];
        arcs.turn_c[k] = arcs.turn_c[k - 1];
        arcs.turn_s[k] = arcs.turn_s[k - 1];
        arcs.mid_c[k] = arcs.mid_c[k - 1];
        arcs.mid_s[k] = arcs.mid_s[k - 1];
        arcs.chord[k] = arcs.chord[k - 1];
    }
    const auto c = static_cast<float>(std::cos(pose.theta));
    const auto s = static_cast<float>(std::sin(pose.theta));
    for (int i = 0; i < kCandidates; ++i) {
        arcs.x[i] = 0.0F;
        arcs.y[i] = 0.0F;
        arcs.hx[i] = c;
        arcs.hy[i] = s;
        arcs.least[i] = 1e9F;
        arcs.hit_s[i] = 1e9F;
        arcs.away[i] = 0.0F;
        arcs.nearest[i] = target_distance;
        const float stop_s = std::abs(arcs.v[i]) / static_cast<float>(limits.max_acceleration);
        // Corners sweep round until the turn has stopped, too.
        const float settle_s = sweeps ? std::abs(arcs.w[i]) / static_cast<float>(limits.max_yaw_acceleration) : 0.0F;
        arcs.brake_s[i] = std::max(stop_s, settle_s) + static_cast<float>(limits.lag_s + 2.0 * dt_s);
    }
}

ADRL_CLONES void step_arcs(Arcs &arcs) {
    for (int i = 0; i < kCandidates; ++i) {
        const float hx = arcs.hx[i];
        const float hy = arcs.hy[i];
        arcs.x[i] += arcs.chord[i] * (hx * arcs.mid_c[i] - hy * arcs.mid_s[i]);
        arcs.y[i] += arcs.chord[i] * (hx * arcs.mid_s[i] + hy * arcs.mid_c[i]);
        arcs.hx[i] = hx * arcs.turn_c[i] - hy * arcs.turn_s[i];
        arcs.hy[i] = hx * arcs.turn_s[i] + hy * arcs.turn_c[i];
        arcs.clear[i] = 1e9F;
    }
}

// Lowers arcs.clear by the distance from a covering disc's centre to each obstacle.
ADRL_CLONES void lower_clear(Arcs &arcs, const Local &local, float offset_x, float offset_y) {
    alignas(64) float px[kCandidates];
    alignas(64) float py[kCandidates];
    for (int i = 0; i < kCandidates; ++i) {
        px[i] = arcs.x[i] + offset_x * arcs.hx[i] - offset_y * arcs.hy[i];
        py[i] = arcs.y[i] + offset_x * arcs.hy[i] + offset_y * arcs.hx[i];
    }
    for (int k = 0; k < local.circles; ++k) {
        const float cx = local.cx[k];
        const float cy = local.cy[k];
        const float cr = local.cr[k];
        for (int i = 0; i < kCandidates; ++i) {
            const float dx = px[i] - cx;
            const float dy = py[i] - cy;
            const float d = std::sqrt(dx * dx + dy * dy) - cr;
            arcs.clear[i] = d < arcs.clear[i] ? d : arcs.clear[i];
        }
    }
    for (int k = 0; k < local.segments; ++k) {
        const float ax = local.ax[k];
        const float ay = local.ay[k];
        const float ex = local.ex[k];
        const float ey = local.ey[k];
        const float inverse = local.inverse[k];
        for (int i = 0; i < kCandidates; ++i) {
            const float rx = px[i] - ax;
            const float ry = py[i] - ay;
            float u = (rx * ex + ry * ey) * inverse;
            u = u < 0.0F ? 0.0F : u;
            u = u > 1.0F ? 1.0F : u;
            const float dx = rx - u * ex;
            const float dy = ry - u * ey;
            const float d = std::sqrt(dx * dx + dy * dy);
            arcs.clear[i] = d < arcs.clear[i] ? d : arcs.clear[i];
        }
    }
}

// Distance from p to the bitmap's solid cells: interpolated between cell centres, less half a cell because the centre
// of a solid cell is not its border. That is good to about half a cell, so below `exact_below` it is measured.
float bitmap_clear(const Bitmap &bitmap, Vec2 p, double exact_below) {
    const Vec2 cell = bitmap.to_cells(p);
    const double x = std::clamp(cell.x - 0.5, 0.0, bitmap.width - 1.001);
    const double y = std::clamp(cell.y - 0.5, 0.0, bitmap.height - 1.001);
    const auto x0 = static_cast<int>(x);
    const auto y0 = static_cast<int>(y);
    const int x1 = std::min(x0 + 1, bitmap.width - 1);
    const int y1 = std::min(y0 + 1, bitmap.height - 1);
    const double fx = x - x0;
    const double fy = y - y0;
    const auto at = [&](int column, int row) -> double {
        return bitmap.distance[static_cast<std::size_t>(row) * bitmap.width + column];
    };
    const double below = at(x0, y0) + fx * (at(x1, y0) - at(x0, y0));
    const double above = at(x0, y1) + fx * (at(x1, y1) - at(x0, y1));
    const double rough = (below + fy * (above - below) - 0.5) * bitmap.resolution;
    if (rough > exact_below + 0.5 * bitmap.resolution) return static_cast<float>(rough);
    return static_cast<float>(point_to_bitmap(bitmap, p, exact_below + bitmap.resolution));
}

void lower_clear_by_bitmap(Arcs &arcs, const Bitmap &bitmap, const Pose &pose, float offset_x, float offset_y,
                           double exact_below) {
    for (int i = 0; i < kSpeeds * kYawRates; ++i) {
        const Vec2 p{pose.x + arcs.x[i] + offset_x * arcs.hx[i] - offset_y * arcs.hy[i],
                     pose.y + arcs.y[i] + offset_x * arcs.hy[i] + offset_y * arcs.hx[i]};
        arcs.clear[i] = std::min(arcs.clear[i], bitmap_clear(bitmap, p, exact_below));
    }
}

// An arc counts until it has come as near to the target as it will: beyond that the next decisions take over, as long
// as the robot can still brake.
ADRL_CLONES void score_sample(Arcs &arcs, float radius, float margin, float time_s, float gx, float gy) {
    for (int i = 0; i < kCandidates; ++i) {
        const float dx = arcs.x[i] - gx;
        const float dy = arcs.y[i] - gy;
        const float distance = std::sqrt(dx * dx + dy * dy);
        const bool counts = (distance <= arcs.nearest[i]) | (time_s <= arcs.brake_s[i]);
        const float clear = counts ? arcs.clear[i] - radius : arcs.least[i];
        const bool hits = (clear < margin) & (arcs.hit_s[i] > 1e8F) & counts;
        arcs.hit_s[i] = hits ? time_s : arcs.hit_s[i];
        arcs.least[i] = clear < arcs.least[i] ? clear : arcs.least[i];
        arcs.nearest[i] = distance < arcs.nearest[i] ? distance : arcs.nearest[i];
        arcs.away[i] += arcs.nearest[i];
    }
}

// An obstacle this far ahead in time can still be braked for: braking evenly takes half the speed's way.
double longest_stop_s(const DriveLimits &limits, double dt_s) {
    return 0.5 * limits.max_speed / limits.max_acceleration + limits.lag_s + 3.0 * dt_s;
}

// Poses along an arc, so close that between two of them no corner gets deeper into the footprint than the margin.
int samples_of(const Cover &cover, const DriveLimits &limits, const DwaConfig &config) {
    const double margin = std::min<double>(config.margin_m, cover.radius);
    const double spacing = 2.0 * std::sqrt(margin * (2.0 * cover.radius - margin)) + 1e-9;
    const double length = std::max(limits.max_speed, -limits.min_speed) * config.horizon_s;
    return static_cast<int>(std::clamp<double>(std::ceil(length / spacing), kLeastSamples, kMostSamples));
}

Twist best_arc(const Arcs &arcs, int samples, const DwaConfig &config, float gx, float gy) {
    double least = std::numeric_limits<double>::infinity();
    Twist best;
    for (int i = 0; i < kSpeeds * kYawRates; ++i) {
        const double dx = gx - arcs.x[i];
        const double dy = gy - arcs.y[i];
        // At the target every heading is as good: without this an arc that ends on it would lose to a slower one.
        const bool arrives = arcs.nearest[i] < kArrived;
        const double off =
            arrives ? 0.0 : std::abs(std::atan2(arcs.hx[i] * dy - arcs.hy[i] * dx, arcs.hx[i] * dx + arcs.hy[i] * dy));
        const double tight = std::max(0.0, 1.0 - arcs.least[i] / config.comfort_m);
        double cost =
            arcs.away[i] / samples + config.heading_weight * off + config.comfort_weight * std::min(tight, 1.0);
        if (arcs.hit_s[i] < config.horizon_s + 1e-6) {
            cost += config.hit_weight * (1.0 - arcs.hit_s[i] / (config.horizon_s + 1e-6));
            // Too late to brake: only better than an arc that hits sooner.
            if (arcs.hit_s[i] <= arcs.brake_s[i]) cost += 1e3 * (1.0 + arcs.brake_s[i] - arcs.hit_s[i]);
        }
        if (cost < least) {
            least = cost;
            best = {arcs.v[i], arcs.w[i]};
        }
    }
    return best;
}

} // namespace

Twist dwa_command(const World &world, const Footprint &footprint, const DriveLimits &limits, const DwaConfig &asked,
                  const Pose &pose, const Twist &twist, Vec2 target, double time_s, double dt_s) {
    DwaConfig config = asked;
    config.horizon_s = std::max(asked.horizon_s, longest_stop_s(limits, dt_s));
    const Cover cover = cover_of(footprint);
    const int samples = samples_of(cover, limits, config);
    const double sample_s = config.horizon_s / samples;
    const auto gx = static_cast<float>(target.x - pose.x);
    const auto gy = static_cast<float>(target.y - pose.y);
    Local local;
    const double speed = std::max(limits.max_speed, -limits.min_speed);
    double reach = speed * config.horizon_s + footprint.radius + config.comfort_m;
    while (!gather(world, pose, reach, local) && reach > footprint.radius) reach *= 0.8;
    const int still = local.circles;
    // A robot that already stands closer than the margin must still be allowed to leave.
    const double start = clearance(world, DiscPlaces(world, time_s), footprint, pose, config.margin_m * 2.0);
    const auto margin = static_cast<float>(std::min(config.margin_m, 0.5 * std::max(start, 0.0)));
    Arcs arcs;
    fill_arcs(arcs, limits, pose, twist, dt_s, sample_s, std::sqrt(gx * gx + gy * gy), !footprint.is_disc());
    for (int k = 1; k <= samples; ++k) {
        step_arcs(arcs);
        const DiscPlaces discs(world, time_s + k * sample_s);
        local.circles = still;
        for (int i = 0; i < discs.count; ++i, ++local.circles) {
            local.cx[local.circles] = static_cast<float>(discs.x[i] - pose.x);
            local.cy[local.circles] = static_cast<float>(discs.y[i] - pose.y);
            local.cr[local.circles] = static_cast<float>(discs.radius[i]);
        }
        for (int i = 0; i < cover.count; ++i) {
            lower_clear(arcs, local, cover.x[i], cover.y[i]);
            if (world.bitmap().empty()) continue;
            lower_clear_by_bitmap(arcs, world.bitmap(), pose, cover.x[i], cover.y[i], cover.radius + config.margin_m);
        }
        score_sample(arcs, cover.radius, margin, static_cast<float>(k * sample_s), gx, gy);
    }
    return best_arc(arcs, samples, config, gx, gy);
}

} // namespace adrl
