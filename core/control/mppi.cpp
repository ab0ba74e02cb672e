#include "control/mppi.hpp"

#include <algorithm>
#include <cmath>

#include "control/mppi_footprint.hpp"
#include "control/obstacle_field.hpp"
#include "random.hpp"

namespace adrl {
namespace {

constexpr int kMaxBatch = kMaxMppiBatch;
constexpr int kBlock = 16; // lanes are padded to it
constexpr int kPathPoints = 64;
constexpr int kAlignStep = 4; // every so many steps are compared with the path

// Samples at the current step, a lane each, in the robot's frame at the start.
struct Rollouts {
    alignas(64) float v[kMaxBatch], w[kMaxBatch];
    alignas(64) float x[kMaxBatch], y[kMaxBatch], hx[kMaxBatch], hy[kMaxBatch];
    alignas(64) float travelled[kMaxBatch];
    alignas(64) float clear[kMaxBatch]; // clearance of the footprint, or of its circumscribed disc
    alignas(64) float live[kMaxBatch];  // 1 until the sample collides
    alignas(64) float cost[kMaxBatch];
    alignas(64) float nearest[kMaxBatch], index[kMaxBatch]; // of the path's points to the last pose
};

struct Base { // limits of the robot, for one step of the rollouts
    float v_min, v_max, w_max, v_change, w_change, response, dt;
    float w_still, curvature; // the yaw rate may be w_still + curvature |v|: on the spot anything, for a car nothing
};

struct PathPoints { // evenly along the path from the robot on, in its frame
    alignas(64) float x[kPathPoints], y[kPathPoints];
    float spacing;
};

ADRL_INLINE float clamped(float value, float low, float high) {
    value = value < low ? low : value;
    return value > high ? high : value;
}

// One step of every sample with the mean control (mean_v, mean_w) and noise around it. price_v, price_w: what a
// difference from the mean costs. gear: 1 where the path is followed forward, else -1. against: what a metre driven in
// the other one costs.
ADRL_CLONES void advance(Rollouts &r, int lanes, const Base &base, float mean_v, float mean_w, float std_v, float std_w,
                         const float *noise_v, const float *noise_w, float price_v, float price_w, float gear,
                         float against) {
    for (int i = 0; i < lanes; ++i) {
        const float cv = clamped(mean_v + std_v * noise_v[i], base.v_min, base.v_max);
        const float cw = clamped(mean_w + std_w * noise_w[i], -base.w_max, base.w_max);
        const float v = r.v[i] + clamped(base.response * (cv - r.v[i]), -base.v_change, base.v_change);
        const float most = base.w_still + base.curvature * std::abs(v);
        const float w =
            clamped(r.w[i] + clamped(base.response * (cw - r.w[i]), -base.w_change, base.w_change), -most, most);
        const float along = 0.5F * (r.v[i] + v) * base.dt;
        const float half = 0.25F * (r.w[i] + w) * base.dt;
        r.v[i] = v;
        r.w[i] = w;
        // Sine and cosine of half the turn by their series: it is below one radian.
        const float h2 = half * half;
        const float sinc = 1.0F - h2 * (1.0F / 6.0F) * (1.0F - h2 * (1.0F / 20.0F) * (1.0F - h2 * (1.0F / 42.0F)));
        const float s = half * sinc;
        const float c = 1.0F - h2 * 0.5F * (1.0F - h2 * (1.0F / 12.0F) * (1.0F - h2 * (1.0F / 30.0F)));
        const float chord = along * sinc;
        const float mx = r.hx[i] * c - r.hy[i] * s;
        const float my = r.hx[i] * s + r.hy[i] * c;
        r.x[i] += chord * mx;
        r.y[i] += chord * my;
        r.hx[i] = mx * c - my * s;
        r.hy[i] = mx * s + my * c;
        const float moved = along < 0.0F ? -along : along;
        r.travelled[i] += moved;
        r.cost[i] += price_v * (cv - mean_v) + price_w * (cw - mean_w) + against * (moved - gear * along);
    }
}

ADRL_CLONES void lower_by_disc(Rollouts &r, int lanes, float x, float y, float radius) {
    for (int i = 0; i < lanes; ++i) {
        const float dx = r.x[i] - x;
        const float dy = r.y[i] - y;
        const float d = std::sqrt(dx * dx + dy * dy) - radius;
        r.clear[i] = d < r.clear[i] ? d : r.clear[i];
    }
}

// What nearness costs: `inner` is how much nearer the circumscribed disc is than the inscribed one, which counts.
ADRL_CLONES void score_room(Rollouts &r, int lanes, float inner, float inflation, float repulsion) {
    for (int i = 0; i < lanes; ++i) {
        const float near = 1.0F - (r.clear[i] + inner) / inflation;
        r.cost[i] += r.live[i] * (near > 0.0F ? repulsion * near : 0.0F);
    }
}

// A collision costs once.
ADRL_CLONES void score_collision(Rollouts &r, int lanes, float margin, float collision) {
    for (int i = 0; i < lanes; ++i) {
        const bool hits = r.clear[i] < margin;
        r.cost[i] += r.live[i] * (hits ? collision : 0.0F);
        r.live[i] = hits ? 0.0F : r.live[i];
    }
}

ADRL_CLONES void score_align(Rollouts &r, int lanes, const PathPoints &path, float weight) {
    for (int i = 0; i < lanes; ++i) {
        const float place = r.travelled[i] / path.spacing;
        const int k = static_cast<int>(place > kPathPoints - 1.0F ? kPathPoints - 1.0F : place);
        const float dx = r.x[i] - path.x[k];
        const float dy = r.y[i] - path.y[k];
        r.cost[i] += weight * std::sqrt(dx * dx + dy * dy);
    }
}

ADRL_CLONES void score_distance(Rollouts &r, int lanes, float x, float y, float weight) {
    for (int i = 0; i < lanes; ++i) {
        const float dx = r.x[i] - x;
        const float dy = r.y[i] - y;
        r.cost[i] += weight * std::sqrt(dx * dx + dy * dy);
    }
}

ADRL_CLONES void score_angle(Rollouts &r, int lanes, float x, float y, float gear, float weight) {
    for (int i = 0; i < lanes; ++i) {
        const float dx = x - r.x[i];
        const float dy = y - r.y[i];
        const float d = std::sqrt(dx * dx + dy * dy) + 1e-6F;
        r.cost[i] += weight * (1.0F - gear * (r.hx[i] * dx + r.hy[i] * dy) / d);
    }
}

ADRL_CLONES void nearest_on_path(Rollouts &r, int lanes, const PathPoints &path) {
    for (int i = 0; i < lanes; ++i) {
        r.nearest[i] = 1e18F;
        r.index[i] = 0.0F;
    }
    for (int k = 0; k < kPathPoints; ++k) {
        for (int i = 0; i < lanes; ++i) {
            const float dx = r.x[i] - path.x[k];
            const float dy = r.y[i] - path.y[k];
            const float d = dx * dx + dy * dy;
            const bool nearer = d < r.nearest[i];
            r.index[i] = nearer ? static_cast<float>(k) : r.index[i];
            r.nearest[i] = nearer ? d : r.nearest[i];
        }
    }
}

class Mppi final : public LocalController {
  public:
    Mppi(const MppiConfig &config, const Footprint &footprint, const DriveLimits &limits, double dt_s)
        : config_(config), lanes_((config.batch_size + kBlock - 1) / kBlock * kBlock),
          noise_(static_cast<std::size_t>(config.time_steps) * 2 * lanes_), weight_(lanes_),
          footprint_(footprint, 0.9 * config.collision_margin_m) {
        field_.reserve(half_side(footprint, limits, dt_s));
        const std::vector<float> noise = mppi_noise(config);
        for (int row = 0; row < 2 * config.time_steps; ++row) {
            std::copy_n(noise.begin() + static_cast<std::ptrdiff_t>(row) * config.batch_size, config.batch_size,
                        noise_.begin() + static_cast<std::ptrdiff_t>(row) * lanes_);
        }
    }

    double reach(const Footprint &footprint, const DriveLimits &limits, double dt_s) const override {
        return travel(limits, dt_s) + footprint.radius + config_.inflation_m;
    }

    Twist command(const Situation &now, double *memory) override {
        prepare(now);
        roll(now, memory);
        score_ends(now.gear);
        return update(now, memory);
    }

  private:
    double step_s(double dt_s) const { return std::max(config_.model_dt, dt_s); }

    double travel(const DriveLimits &limits, double dt_s) const {
        return std::max(limits.max_speed, -limits.min_speed) * config_.time_steps * step_s(dt_s);
    }

    double half_side(const Footprint &footprint, const DriveLimits &limits, double dt_s) const {
        return travel(limits, dt_s) + footprint.radius + ObstacleField::kSpacing;
    }

    const float *noise(int step, int which) const {
        return noise_.data() + static_cast<std::ptrdiff_t>(2 * step + which) * lanes_;
    }

    static Vec2 seen(const Pose &pose, Vec2 p) {
        const double c = std::cos(pose.theta), s = std::sin(pose.theta);
        const Vec2 d = p - Vec2{pose.x, pose.y};
        return {c * d.x + s * d.y, c * d.y - s * d.x};
    }

    void prepare(const Situation &now) {
        const double far = travel(now.limits, now.dt_s);
        const double most = now.footprint.radius + config_.inflation_m;
        field_.fill(now.obstacles, now.pose.theta, half_side(now.footprint, now.limits, now.dt_s), most);
        const double clear = now.obstacles.clearance(now.footprint, {0.0, 0.0, now.pose.theta}, most, 0.0);
        // A robot that already stands closer than the margin must still be allowed to leave.
        margin_ = static_cast<float>(std::min(config_.collision_margin_m, 0.5 * std::max(clear, 0.0)));
        const double spacing = (far + config_.path_follow_offset_m) / (kPathPoints - 1);
        for (int k = 0; k < kPathPoints; ++k) {
            const Vec2 p = seen(now.pose, now.path.at(std::min(now.along + k * spacing, now.stop)));
            path_.x[k] = static_cast<float>(p.x);
            path_.y[k] = static_cast<float>(p.y);
        }
        path_.spacing = static_cast<float>(spacing);
        goal_ = seen(now.pose, now.path.at(now.stop));
        near_goal_ = static_cast<float>(now.stop - now.along) < config_.goal_threshold_m;
        // A car that leaves its path may not come there at all.
        on_path_ = !near_goal_ || now.limits.is_car();
        std::fill_n(r_.v, lanes_, static_cast<float>(now.twist.v));
        std::fill_n(r_.w, lanes_, static_cast<float>(now.twist.w));
        for (float *zero : {r_.x, r_.y, r_.hy, r_.travelled, r_.cost}) std::fill_n(zero, lanes_, 0.0F);
        for (float *one : {r_.hx, r_.live}) std::fill_n(one, lanes_, 1.0F);
    }

    void roll(const Situation &now, const double *mean) {
        const DriveLimits &limits = now.limits;
        const double dt = step_s(now.dt_s);
        const double response = limits.lag_s > 0.0 ? -std::expm1(-dt / limits.lag_s) : 1.0;
        const Base base{static_cast<float>(limits.min_speed),
                        static_cast<float>(limits.max_speed),
                        static_cast<float>(limits.max_yaw_rate),
                        static_cast<float>(limits.max_acceleration * dt),
                        static_cast<float>(limits.max_yaw_acceleration * dt),
                        static_cast<float>(response),
                        static_cast<float>(dt),
                        limits.is_car() ? 0.0F : static_cast<float>(kFarAway),
                        limits.is_car() ? static_cast<float>(1.0 / limits.min_turning_radius) : 0.0F};
        const double v_std = config_.vx_std * limits.max_speed, w_std = config_.wz_std * limits.max_yaw_rate;
        const auto sv = static_cast<float>(v_std), sw = static_cast<float>(w_std);
        const int steps = config_.time_steps;
        const auto share = static_cast<float>(1.0 / steps);
        for (int t = 0; t < steps; ++t) {
            const double v = mean[2 * t], w = mean[2 * t + 1];
            advance(r_, lanes_, base, static_cast<float>(v), static_cast<float>(w), sv, sw, noise(t, 0), noise(t, 1),
                    static_cast<float>(v_std > 0.0 ? config_.gamma * v / (v_std * v_std) : 0.0),
                    static_cast<float>(w_std > 0.0 ? config_.gamma * w / (w_std * w_std) : 0.0),
                    static_cast<float>(now.gear), static_cast<float>(0.5 * config_.prefer_forward_weight));
            measure(now, (t + 1) * dt, share * static_cast<float>(config_.repulsion_weight));
            const double soon = 1.0 + static_cast<double>(steps - t) / steps;
            score_collision(r_, lanes_, margin_, static_cast<float>(config_.collision_cost * soon));
            if (near_goal_) {
                score_distance(r_, lanes_, static_cast<float>(goal_.x), static_cast<float>(goal_.y),
                               share * static_cast<float>(config_.goal_weight));
            }
            if (on_path_ && t % kAlignStep == kAlignStep - 1) {
                score_align(r_, lanes_, path_, share * kAlignStep * static_cast<float>(config_.path_align_weight));
            }
        }
    }

    // Clearances at the current step, and what nearness costs. As in Nav2 a disc tells of nearness, and where the
    // circumscribed one might hit, the footprint tells whether it does.
    void measure(const Situation &now, double after_s, float repulsion) {
        const auto body = static_cast<float>(now.footprint.radius);
        field_.look_up(r_.x, r_.y, lanes_, r_.clear);
        for (int i = 0; i < lanes_; ++i) r_.clear[i] -= body;
        const NearObstacles &all = now.obstacles;
        const int still = all.count(), count = now.obstacles.place_discs(after_s);
        discs_.count = count - still;
        for (int k = 0; k < discs_.count; ++k) {
            const Vec2 p = seen({0.0, 0.0, now.pose.theta}, {all.ax[still + k], all.ay[still + k]});
            discs_.x[k] = static_cast<float>(p.x);
            discs_.y[k] = static_cast<float>(p.y);
            discs_.radius[k] = all.radius[still + k];
            lower_by_disc(r_, lanes_, discs_.x[k], discs_.y[k], discs_.radius[k] + body);
        }
        score_room(r_, lanes_, body - footprint_.inscribed(), static_cast<float>(config_.inflation_m), repulsion);
        if (now.footprint.is_disc()) return;
        footprint_.begin();
        for (int i = 0; i < lanes_; ++i)
            if (r_.clear[i] < margin_ && r_.live[i] != 0.0F) footprint_.add(i, r_.x[i], r_.y[i], r_.hx[i], r_.hy[i]);
        footprint_.measure(field_, discs_, body, r_.clear);
    }

    // What the last poses cost: their way to a point beyond the farthest one of the path that samples reach.
    void score_ends(double gear) {
        if (!on_path_) return;
        nearest_on_path(r_, lanes_, path_);
        float furthest = 0.0F;
        for (int i = 0; i < config_.batch_size; ++i) furthest = std::max(furthest, r_.live[i] * r_.index[i]);
        const int offset = static_cast<int>(std::lround(config_.path_follow_offset_m / path_.spacing));
        const int k = std::min(static_cast<int>(furthest) + offset, kPathPoints - 1);
        score_distance(r_, lanes_, path_.x[k], path_.y[k], static_cast<float>(config_.path_follow_weight));
        const double bearing = std::atan2(gear * path_.y[k], gear * path_.x[k]);
        if (std::abs(bearing) > config_.max_angle_to_furthest)
            score_angle(r_, lanes_, path_.x[k], path_.y[k], static_cast<float>(gear),
                        static_cast<float>(config_.path_angle_weight));
    }

    // The new mean, and its first control; the mean moves on by one control period.
    Twist update(const Situation &now, double *mean) {
        const int count = config_.batch_size;
        const float least = *std::min_element(r_.cost, r_.cost + count);
        double sum = 0.0;
        for (int i = 0; i < count; ++i) {
            weight_[i] = static_cast<float>(std::exp((least - r_.cost[i]) / config_.temperature));
            sum += weight_[i];
        }
        const DriveLimits &limits = now.limits;
        const auto sv = static_cast<float>(config_.vx_std * limits.max_speed);
        const auto sw = static_cast<float>(config_.wz_std * limits.max_yaw_rate);
        const auto v_min = static_cast<float>(limits.min_speed), v_max = static_cast<float>(limits.max_speed);
        const auto w_max = static_cast<float>(limits.max_yaw_rate);
        const int steps = config_.time_steps;
        for (int t = 0; t < steps; ++t) {
            const auto mv = static_cast<float>(mean[2 * t]), mw = static_cast<float>(mean[2 * t + 1]);
            const float *nv = noise(t, 0), *nw = noise(t, 1);
            double v = 0.0, w = 0.0;
            for (int i = 0; i < count; ++i) {
                if (weight_[i] < 1e-12F) continue;
                v += weight_[i] * clamped(mv + sv * nv[i], v_min, v_max);
                w += weight_[i] * clamped(mw + sw * nw[i], -w_max, w_max);
            }
            mean[2 * t] = v / sum;
            mean[2 * t + 1] = w / sum;
        }
        const Twist first{mean[0], mean[1]};
        const double part = now.dt_s / step_s(now.dt_s);
        for (int t = 0; t + 1 < steps; ++t) {
            mean[2 * t] += part * (mean[2 * t + 2] - mean[2 * t]);
            mean[2 * t + 1] += part * (mean[2 * t + 3] - mean[2 * t + 1]);
        }
        return first;
    }

    MppiConfig config_;
    int lanes_;
    std::vector<float> noise_; // (time_steps, 2, lanes)
    std::vector<float> weight_;
    Rollouts r_;
    PathPoints path_;
    ObstacleField field_;
    SeenDiscs discs_;
    MppiFootprint footprint_;
    float margin_ = 0.0F;
    Vec2 goal_;
    bool near_goal_ = false, on_path_ = true; // whether the critics of the goal, and those of the path, count
};

} // namespace

int mppi_memory(const MppiConfig &config) { return 2 * config.time_steps; }

std::vector<float> mppi_noise(const MppiConfig &config) {
    const int steps = config.time_steps, count = config.batch_size;
    std::vector<float> noise(static_cast<std::size_t>(steps) * 2 * count);
    const double rho = config.noise_correlation, fresh = std::sqrt(1.0 - rho * rho);
    for (int i = 0; i < count; ++i) {
        for (int which = 0; which < 2; ++which) {
            const std::uint64_t key = random_key(static_cast<std::uint64_t>(which), static_cast<std::uint64_t>(i / 2));
            const double sign = which == 1 && i % 2 == 1 ? -1.0 : 1.0;
            double value = 0.0;
            for (int t = 0; t < steps; ++t) {
                const double drawn = nearly_normal(mix64(key + static_cast<std::uint64_t>(t)));
                value = t == 0 ? drawn : rho * value + fresh * drawn;
                noise[(static_cast<std::size_t>(t) * 2 + which) * count + i] = static_cast<float>(sign * value);
            }
        }
    }
    return noise;
}

std::unique_ptr<LocalController> make_mppi(const MppiConfig &config, const Footprint &footprint,
                                           const DriveLimits &limits, double dt_s) {
    return std::make_unique<Mppi>(config, footprint, limits, dt_s);
}

} // namespace adrl
