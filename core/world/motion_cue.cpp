#include "world/motion_cue.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace adrl {
namespace {

constexpr int kMost = 2048; // beams, and sectors
constexpr double kTwoPi = 2.0 * std::numbers::pi;
// Parts of a sector or beam that a bearing may be off by: the arc tangent is good to 2e-5 rad.
constexpr double kSlack = 1e-3;

// How one sensor's frame lies in another's.
struct Change {
    double c, s, x, y;
    Change(const Pose &from, const Pose &to) {
        c = std::cos(from.theta - to.theta);
        s = std::sin(from.theta - to.theta);
        const double dx = from.x - to.x, dy = from.y - to.y;
        x = std::cos(to.theta) * dx + std::sin(to.theta) * dy;
        y = std::cos(to.theta) * dy - std::sin(to.theta) * dx;
    }
};

// Where end points of one scan lie for a sensor elsewhere: distance, and number of the beam that points there.
struct Seen {
    float distance[kMost], beam[kMost];
};

ADRL_CLONES void look(const float *ranges, const double *dx, const double *dy, int count, double max_range,
                      const Change &change, double angle_min, double increment, Seen &seen) {
    const double circle = kTwoPi / increment;
    // Bearings behind a fan are numbered from whichever of its ends is nearer.
    const double behind = 0.5 * (circle - (count - 1));
    for (int i = 0; i < count; ++i) {
        double range = ranges[i];
        range = range < max_range ? range : max_range; // not-a-number too
        const double x = range * dx[i], y = range * dy[i];
        const double px = change.c * x - change.s * y + change.x;
        const double py = change.s * x + change.c * y + change.y;
        const double number = (rough_atan2(py, px) - angle_min) / increment;
        seen.distance[i] = static_cast<float>(std::sqrt(px * px + py * py));
        seen.beam[i] = static_cast<float>(number - circle * std::floor((number + behind) / circle));
    }
}

} // namespace

MotionCue::MotionCue(const CueConfig &config)
    : config_(config), full_circle_(std::abs(config.num_beams * config.increment - kTwoPi) < 1e-6) {
    for (int i = 0; i < config_.num_beams; ++i) {
        dx_.push_back(std::cos(config_.angle_min + i * config_.increment));
        dy_.push_back(std::sin(config_.angle_min + i * config_.increment));
    }
}

void MotionCue::compute(const float *ranges, const Pose &pose, const float *past_ranges, const Pose &past_pose,
                        float *out) const {
    const auto range = static_cast<float>(config_.max_range);
    const Pose now = compose(pose, config_.mount), then = compose(past_pose, config_.mount);
    Seen seen;
    float come[kMost] = {}, gone[kMost] = {};
    const auto see = [&](const float *hits, const Pose &from, const Pose &to) {
        look(hits, dx_.data(), dy_.data(), config_.num_beams, config_.max_range, Change(from, to), config_.angle_min,
             config_.increment, seen);
    };
    see(ranges, now, then);
    for (int i = 0; i < config_.num_beams; ++i) {
        if (ranges[i] < range) mark(i, free_beyond(past_ranges, seen.beam[i], seen.distance[i]), come);
    }
    see(past_ranges, then, now);
    for (int i = 0; i < config_.num_beams; ++i) {
        if (past_ranges[i] < range) mark(seen.beam[i], free_beyond(ranges, seen.beam[i], seen.distance[i]), gone);
    }
    for (int s = 0; s < config_.num_sectors; ++s) {
        const float metres = come[s] > 0.0F ? -come[s] : gone[s];
        out[s] = std::clamp(metres / static_cast<float>(config_.scale), -1.0F, 1.0F);
    }
}

float MotionCue::free_beyond(const float *ranges, double beam, double distance) const {
    const int count = config_.num_beams;
    if (!full_circle_ && (beam < -kSlack || beam > count - 1 + kSlack)) return 0.0F; // out of view
    const int middle = static_cast<int>(std::floor(beam + 0.5));
    const auto at = [&](int i) { return ranges[full_circle_ ? (i + count) % count : std::clamp(i, 0, count - 1)]; };
    const float free = std::min({at(middle - 1), at(middle), at(middle + 1)});
    return free - static_cast<float>(distance + config_.margin);
}

void MotionCue::mark(double beam, float metres, float *sectors) const {
    if (!(metres > 0.0F)) return;
    const double angle = config_.angle_min + beam * config_.increment + config_.mount.theta;
    const double place = (angle + std::numbers::pi) / kTwoPi * config_.num_sectors;
    // A point on the border of two sectors is in both: a mirrored scan gives mirrored cues.
    for (const double side : {place - kSlack, place + kSlack}) {
        const double turns = std::floor(side / config_.num_sectors);
        float &sector = sectors[static_cast<int>(side - turns * config_.num_sectors)];
        sector = std::max(sector, metres);
    }
}

} // namespace adrl
