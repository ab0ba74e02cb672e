#include "control/dwa.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "planning/path_guide.hpp"

namespace adrl {
namespace {

constexpr int kSpeeds = 7;
constexpr int kYawRates = 17;
constexpr int kLeastSamples = 10; // poses along an arc
constexpr int kMostSamples = 64;
constexpr int kCandidates = 128;
static_assert(kSpeeds * kYawRates <= kCandidates && kCandidates % 16 == 0);
constexpr float kArrived = 0.1F; // metres from the target

// Metres relative to the robot's position, axes of the world, in single precision.
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
        double yaw_rate = w_low + (w_high - w_low) * j / (kYawRates - 1);
        if (j == kYawRates / 2 && w_low < 0.0 && w_high > 0.0) yaw_rate = 0.0; // straight on is always among them
        for (int i = 0; i < kSpeeds; ++i, ++k) {
            double v = v_low + (v_high - v_low) * i / (kSpeeds - 1);
            // So is standing still, where the window holds it.
            if (v_low < 0.0 && v_high > 0.0 && std::abs(v) <= 0.5 * (v_high - v_low) / (kSpeeds - 1)) v = 0.0;
            const double w = steerable({v, yaw_rate}, limits).w;
            const double half = 0.5 * w * sample_s;
            const double sinc = std::abs(half) < 1e-4 ? 1.0 : std::sin(half) / half;
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
    }
}

struct Box {
    float x_min, x_max, y_min, y_max;
};

// Around the robot's centre on all arcs at the current sample.
ADRL_CLONES Box box_of(const Arcs &arcs) {
    Box box{arcs.x[0], arcs.x[0], arcs.y[0], arcs.y[0]};
    for (int i = 1; i < kCandidates; ++i) {
        box.x_min = arcs.x[i] < box.x_min ? arcs.x[i] : box.x_min;
        box.x_max = arcs.x[i] > box.x_max ? arcs.x[i] : box.x_max;
        box.y_min = arcs.y[i] < box.y_min ? arcs.y[i] : box.y_min;
        box.y_max = arcs.y[i] > box.y_max ? arcs.y[i] : box.y_max;
    }
    return box;
}

// Whether a capsule may come within `reach` of a point of the box.
bool near_box(const NearObstacles &all, int k, const Box &box, float reach) {
    const float far = reach + all.radius[k];
    const float bx = all.ax[k] + all.ex[k];
    const float by = all.ay[k] + all.ey[k];
    return std::min(all.ax[k], bx) <= box.x_max + far && std::max(all.ax[k], bx) >= box.x_min - far &&
           std::min(all.ay[k], by) <= box.y_max + far && std::max(all.ay[k], by) >= box.y_min - far;
}

// Lowers arcs.clear to the distance from a disc's edge to a capsule.
ADRL_CLONES void lower_disc(Arcs &arcs, float disc, float ax, float ay, float ex, float ey, float inverse,
                            float radius) {
    for (int i = 0; i < kCandidates; ++i) {
        const float rx = arcs.x[i] - ax;
        const float ry = arcs.y[i] - ay;
        float u = (rx * ex + ry * ey) * inverse;
        u = u < 0.0F ? 0.0F : u;
        u = u > 1.0F ? 1.0F : u;
        const float dx = rx - u * ex;
        const float dy = ry - u * ey;
        const float d = std::sqrt(dx * dx + dy * dy) - radius - disc;
        arcs.clear[i] = d < arcs.clear[i] ? d : arcs.clear[i];
    }
}

struct Edge { // of a polygon in the robot's frame: a corner, the way to the next one, and the normal that points out
    float x, y, ex, ey, inverse, nx, ny;
};

// The distance from a convex polygon to a segment, a lane an arc: the least of those from the ends to the edges and
// from the corners to the segment, and 0 where no edge and not the segment separates them.
struct Lanes {
    alignas(64) float ax[kCandidates], ay[kCandidates], bx[kCandidates], by[kCandidates]; // ends in the robot's frame
    alignas(64) float apart[kCandidates];                  // greatest separation along a normal so far
    alignas(64) float low[kCandidates], high[kCandidates]; // corners' places across the segment's line, times |e|
    alignas(64) float least[kCandidates];                  // squared distance
};

ADRL_CLONES void begin_lanes(const Arcs &arcs, Lanes &lanes, float ax, float ay, float ex, float ey) {
    for (int i = 0; i < kCandidates; ++i) {
        const float rx = ax - arcs.x[i];
        const float ry = ay - arcs.y[i];
        lanes.ax[i] = arcs.hx[i] * rx + arcs.hy[i] * ry;
        lanes.ay[i] = arcs.hx[i] * ry - arcs.hy[i] * rx;
        lanes.bx[i] = lanes.ax[i] + (arcs.hx[i] * ex + arcs.hy[i] * ey);
        lanes.by[i] = lanes.ay[i] + (arcs.hx[i] * ey - arcs.hy[i] * ex);
        lanes.apart[i] = -1e9F;
        lanes.low[i] = 1e9F;
        lanes.high[i] = -1e9F;
        lanes.least[i] = 1e18F;
    }
}

ADRL_INLINE float squared_to_edge(const Edge &edge, float px, float py) {
    const float rx = px - edge.x;
    const float ry = py - edge.y;
    float u = (rx * edge.ex + ry * edge.ey) * edge.inverse;
    u = u < 0.0F ? 0.0F : u;
    u = u > 1.0F ? 1.0F : u;
    const float dx = rx - u * edge.ex;
    const float dy = ry - u * edge.ey;
    return dx * dx + dy * dy;
}

ADRL_CLONES void add_edge(Lanes &lanes, const Edge &edge, float inverse) {
    for (int i = 0; i < kCandidates; ++i) {
        const float ax = lanes.ax[i], ay = lanes.ay[i], bx = lanes.bx[i], by = lanes.by[i];
        const float out_a = edge.nx * (ax - edge.x) + edge.ny * (ay - edge.y);
        const float out_b = edge.nx * (bx - edge.x) + edge.ny * (by - edge.y);
        const float out = out_a < out_b ? out_a : out_b;
        lanes.apart[i] = out > lanes.apart[i] ? out : lanes.apart[i];
        const float from_a = squared_to_edge(edge, ax, ay);
        const float from_b = squared_to_edge(edge, bx, by);
        // The corner to the segment, and on which side of its line it lies.
        const float sx = bx - ax, sy = by - ay;
        const float rx = edge.x - ax, ry = edge.y - ay;
        const float side = sx * ry - sy * rx;
        lanes.low[i] = side < lanes.low[i] ? side : lanes.low[i];
        lanes.high[i] = side > lanes.high[i] ? side : lanes.high[i];
        float u = (rx * sx + ry * sy) * inverse;
        u = u < 0.0F ? 0.0F : u;
        u = u > 1.0F ? 1.0F : u;
        const float dx = rx - u * sx, dy = ry - u * sy;
        float least = dx * dx + dy * dy;
        least = from_a < least ? from_a : least;
        least = from_b < least ? from_b : least;
        lanes.least[i] = least < lanes.least[i] ? least : lanes.least[i];
    }
}

ADRL_CLONES void end_lanes(Arcs &arcs, const Lanes &lanes, float radius) {
    for (int i = 0; i < kCandidates; ++i) {
        const bool overlap = (lanes.apart[i] <= 0.0F) & (lanes.low[i] <= 0.0F) & (lanes.high[i] >= 0.0F);
        const float d = (overlap ? 0.0F : std::sqrt(lanes.least[i])) - radius;
        arcs.clear[i] = d < arcs.clear[i] ? d : arcs.clear[i];
    }
}

// An arc counts until it has come as near to the target as it will: beyond that the next decisions take over, as long
// as the robot can still brake.
ADRL_CLONES void score_sample(Arcs &arcs, float margin, float time_s, float gx, float gy) {
    for (int i = 0; i < kCandidates; ++i) {
        const float dx = arcs.x[i] - gx;
        const float dy = arcs.y[i] - gy;
        const float distance = std::sqrt(dx * dx + dy * dy);
        const bool counts = (distance <= arcs.nearest[i]) | (time_s <= arcs.brake_s[i]);
        const float clear = counts ? arcs.clear[i] : arcs.least[i];
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
int samples_of(const Footprint &footprint, const DriveLimits &limits, const DwaConfig &config) {
    const double margin = std::min(config.margin_m, footprint.radius);
    const double spacing = 2.0 * std::sqrt(margin * (2.0 * footprint.radius - margin)) + 1e-9;
    const double length = std::max(limits.max_speed, -limits.min_speed) * config.horizon_s;
    return static_cast<int>(std::clamp<double>(std::ceil(length / spacing), kLeastSamples, kMostSamples));
}

// gear: 1 for an end that looks at the target, -1 for one that looks away from it.
Twist best_arc(const Arcs &arcs, int samples, const DwaConfig &config, float gx, float gy, double gear) {
    double least = std::numeric_limits<double>::infinity();
    Twist best;
    for (int i = 0; i < kSpeeds * kYawRates; ++i) {
        const double dx = gear * (gx - arcs.x[i]);
        const double dy = gear * (gy - arcs.y[i]);
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

class Dwa final : public LocalController {
  public:
    explicit Dwa(const DwaConfig &config) : config_(config) {}

    double reach(const Footprint &footprint, const DriveLimits &limits, double dt_s) const override {
        const double speed = std::max(limits.max_speed, -limits.min_speed);
        return speed * horizon_s(limits, dt_s) + footprint.radius + config_.comfort_m;
    }

    Twist command(const Situation &now, double *) override {
        DwaConfig config = config_;
        config.horizon_s = horizon_s(now.limits, now.dt_s);
        const int samples = samples_of(now.footprint, now.limits, config);
        const double sample_s = config.horizon_s / samples;
        const Vec2 here{now.pose.x, now.pose.y};
        const double corridor = now.footprint.radius + 0.5 * config.margin_m;
        const Vec2 target = visible_waypoint(now.path, now.along, now.stop, config.lookahead, [&](Vec2 point) {
            return now.obstacles.corridor_free({}, point - here, corridor);
        });
        const auto gx = static_cast<float>(target.x - here.x);
        const auto gy = static_cast<float>(target.y - here.y);
        set_edges(now.footprint);
        fill_arcs(arcs_, now.limits, now.pose, now.twist, now.dt_s, sample_s, std::sqrt(gx * gx + gy * gy),
                  !now.footprint.is_disc());
        // A robot that already stands closer than the margin must still be allowed to leave.
        measure(now, 0.0);
        const float margin = std::min(static_cast<float>(config.margin_m), 0.5F * std::max(arcs_.clear[0], 0.0F));
        for (int k = 1; k <= samples; ++k) {
            step_arcs(arcs_);
            measure(now, k * sample_s);
            score_sample(arcs_, margin, static_cast<float>(k * sample_s), gx, gy);
        }
        return lead_lag(best_arc(arcs_, samples, config, gx, gy, now.gear), now.twist, now.limits, now.dt_s);
    }

  private:
    double horizon_s(const DriveLimits &limits, double dt_s) const {
        return std::max(config_.horizon_s, longest_stop_s(limits, dt_s));
    }

    void set_edges(const Footprint &footprint) {
        const auto count = footprint.corners.size();
        for (std::size_t k = 0; k < count; ++k) {
            const Vec2 a = footprint.corners[k];
            const Vec2 e = footprint.corners[(k + 1) % count] - a;
            const double length = norm(e);
            edges_[k] = {static_cast<float>(a.x),
                         static_cast<float>(a.y),
                         static_cast<float>(e.x),
                         static_cast<float>(e.y),
                         static_cast<float>(1.0 / dot(e, e)),
                         static_cast<float>(e.y / length),
                         static_cast<float>(-e.x / length)};
        }
    }

    // Clearances of the current sample, up to what makes a difference.
    void measure(const Situation &now, double after_s) {
        const auto limit = static_cast<float>(std::max(config_.comfort_m, 2.0 * config_.margin_m));
        std::fill(arcs_.clear, arcs_.clear + kCandidates, limit);
        NearObstacles &all = now.obstacles;
        const int count = all.place_discs(after_s);
        const Box box = box_of(arcs_);
        const auto body = static_cast<float>(now.footprint.radius);
        for (int k = 0; k < count; ++k) {
            if (!near_box(all, k, box, body + limit)) continue;
            if (now.footprint.is_disc()) {
                lower_disc(arcs_, body, all.ax[k], all.ay[k], all.ex[k], all.ey[k], all.inverse[k], all.radius[k]);
                continue;
            }
            begin_lanes(arcs_, lanes_, all.ax[k], all.ay[k], all.ex[k], all.ey[k]);
            for (std::size_t e = 0; e < now.footprint.corners.size(); ++e) add_edge(lanes_, edges_[e], all.inverse[k]);
            end_lanes(arcs_, lanes_, all.radius[k]);
        }
    }

    DwaConfig config_;
    Arcs arcs_;
    Lanes lanes_;
    Edge edges_[kMaxCorners];
};

} // namespace

std::unique_ptr<LocalController> make_dwa(const DwaConfig &config) { return std::make_unique<Dwa>(config); }

} // namespace adrl
