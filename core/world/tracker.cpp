#include "world/tracker.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace adrl {
namespace {

constexpr double kJoined = 0.2;      // metres: neighbouring hits nearer than this,
constexpr double kJoinedBeams = 2.5; // and no more beams apart, are of one piece
constexpr double kPerson = 0.6;      // metres across of what one person's legs are within,
constexpr int kBeside = 4;           // of which nothing is hit but fewer other clusters between them
constexpr double kLost = 0.5;        // seconds for which a cluster that is not seen is looked for
constexpr double kWidest = 1.0;      // metres: wider pieces are walls
constexpr double kOver = 0.4;        // seconds over whose places a velocity is taken,
constexpr double kLeast = 0.15;      // and not over less
constexpr double kSlack = 0.1;       // metres beside the fastest way by which a cluster may be elsewhere
constexpr double kFree = 0.08;       // metres by which an earlier scan must have looked beyond a hit
constexpr double kCame = 0.2;        // part of the hits for which one has
constexpr double kSlowest = 0.15;    // m/s: slower things stand
constexpr double kStops = 0.5;       // seconds for which a cluster that was seen to move is taken to after that
constexpr double kRounding = 1e-6;   // seconds
constexpr double kTwoPi = 2.0 * std::numbers::pi;

bool all_round(std::size_t num_beams, double increment) {
    return (static_cast<double>(num_beams) + 0.5) * std::abs(increment) > kTwoPi;
}

} // namespace

bool Track::moves(double now_s) const { return now_s - moved_s_ <= kStops; }

void Track::begin(double now_s, Vec2 point) {
    first_ = 0;
    count_ = 1;
    velocity_ = {};
    since_s_ = now_s;
    moved_s_ = -std::numeric_limits<double>::infinity();
    moved_ = 0;
    places_[0] = {now_s, point};
}

void Track::add(double now_s, Vec2 point) {
    const auto drop = [&] {
        first_ = at(1);
        --count_;
    };
    if (count_ == kMostPlaces) drop();
    places_[at(count_++)] = {now_s, point};
    while (places_[first_].stamp_s < now_s - kOver - kRounding) drop();
}

bool Track::measure() {
    const double now_s = places_[at(count_ - 1)].stamp_s;
    if (now_s - places_[first_].stamp_s < kLeast) return false;
    double mean_s = 0.0;
    for (int k = 0; k < count_; ++k) mean_s += (places_[at(k)].stamp_s - now_s) / count_;
    double squares = 0.0;
    Vec2 sum;
    for (int k = 0; k < count_; ++k) {
        const Place &place = places_[at(k)];
        const double off_s = place.stamp_s - now_s - mean_s;
        squares += off_s * off_s;
        sum = sum + off_s * place.point;
    }
    const double speed = norm(sum) / squares;
    velocity_ = (kFastestMover / std::max(speed, kFastestMover) / squares) * sum;
    return speed > kSlowest;
}

void Tracker::forget() {
    unused_.resize(pool_.size());
    std::iota(unused_.begin(), unused_.end(), 0);
    live_.clear();
    lost_.clear();
    num_past_ = 0;
}

void Tracker::take(const PlacedScan &scan) {
    if (num_past_ > 0 && scan.stamp_s <= past_[num_past_ - 1].stamp_s) forget();
    cluster(scan);
    lost_.insert(lost_.end(), live_.begin(), live_.end());
    live_.clear();
    for (int c = 0; c < static_cast<int>(clusters_.size()); ++c) {
        const Cluster &found = clusters_[c];
        const int number = follow(scan.stamp_s, (1.0 / found.count) * found.sum);
        Track &track = pool_[number];
        track.breadth_ = norm(found.high - found.low);
        if (track.measure() && came(scan, c)) {
            track.moved_s_ = scan.stamp_s;
            ++track.moved_;
        }
        live_.push_back(number);
    }
    std::erase_if(lost_, [&](int number) {
        const bool gone = pool_[number].last_s() < scan.stamp_s - kLost - kRounding;
        if (gone) unused_.push_back(number);
        return gone;
    });
    remember(scan);
}

// Joins neighbouring hits to pieces, and pieces that one person has room for, as legs, to clusters. Walls are none.
void Tracker::cluster(const PlacedScan &scan) {
    clusters_.clear();
    const int count = static_cast<int>(scan.points.size());
    track_of_hit_.assign(scan.points.size(), -1);
    const double circle = kTwoPi / std::abs(scan.increment);
    // Whether hit i and the one after it are of two pieces; after the last one comes, round the circle, the first.
    const auto splits = [&](int i) {
        const int next = i + 1 < count ? i + 1 : 0;
        const Vec2 way = scan.points[next] - scan.points[i];
        const double turned = scan.beams[next] - scan.beams[i] + (next == 0 ? circle : 0.0);
        return dot(way, way) > kJoined * kJoined || turned > kJoinedBeams;
    };
    int last = count - 1;
    while (last >= 0 && !splits(last)) --last;
    if (last < 0) return; // nothing, or a wall all round
    const auto joined = [](const Cluster &a, const Cluster &b) {
        return Cluster{{std::min(a.low.x, b.low.x), std::min(a.low.y, b.low.y)},
                       {std::max(a.high.x, b.high.x), std::max(a.high.y, b.high.y)},
                       a.sum + b.sum,
                       a.count + b.count};
    };
    const auto after = [&](int k) { return last + k < count ? last + k : last + k - count; };
    Cluster piece;
    int begin = 1;
    for (int k = 1; k <= count; ++k) {
        const int i = after(k);
        const Cluster hit{scan.points[i], scan.points[i], scan.points[i], 1};
        piece = k == begin ? hit : joined(piece, hit);
        if (!splits(i)) continue;
        if (norm(piece.high - piece.low) < kWidest) {
            const int known = static_cast<int>(clusters_.size());
            int c = known - 1;
            while (c >= 0 && c > known - kBeside) {
                const Cluster whole = joined(clusters_[c], piece);
                if (norm(whole.high - whole.low) < kPerson) break;
                --c;
            }
            if (c < 0 || c <= known - kBeside) {
                c = known;
                clusters_.push_back(piece);
            } else {
                clusters_[c] = joined(clusters_[c], piece);
            }
            for (int m = begin; m <= k; ++m) track_of_hit_[after(m)] = c;
        }
        begin = k + 1;
    }
}

// The track of late that is nearest to where it is expected, taken out of them; else a new one.
int Tracker::follow(double now_s, Vec2 point) {
    std::size_t nearest = lost_.size();
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < lost_.size(); ++k) {
        const Track &track = pool_[lost_[k]];
        const double passed_s = now_s - track.last_s();
        const Vec2 velocity = track.velocity();
        const bool known = velocity.x != 0.0 || velocity.y != 0.0;
        const double reach = (known ? 0.5 : 1.0) * kFastestMover * passed_s + kSlack;
        const Vec2 off = track.place() + passed_s * velocity - point;
        const double off2 = dot(off, off);
        if (off2 < least && off2 < reach * reach) {
            nearest = k;
            least = off2;
        }
    }
    if (nearest < lost_.size()) {
        const int number = lost_[nearest];
        lost_.erase(lost_.begin() + static_cast<std::ptrdiff_t>(nearest));
        pool_[number].add(now_s, point);
        return number;
    }
    if (unused_.empty()) {
        unused_.push_back(static_cast<int>(pool_.size()));
        pool_.emplace_back();
    }
    const int number = unused_.back();
    unused_.pop_back();
    pool_[number].begin(now_s, point);
    return number;
}

// Whether enough hits of a cluster lie where one of the scans of a while ago has passed, with both beams beside.
bool Tracker::came(const PlacedScan &scan, int cluster) const {
    const auto was_free = [&](const Past &past, Vec2 point) {
        const double dx = point.x - past.sensor.x, dy = point.y - past.sensor.y;
        const double turned = rough_atan2(dy, dx) - past.sensor.theta - past.angle_min;
        const double along = std::copysign(1.0, past.increment) * turned;
        const auto count = static_cast<std::ptrdiff_t>(past.seen.size());
        auto beam = std::lrint((along - kTwoPi * std::floor(along / kTwoPi)) / std::abs(past.increment));
        const bool whole = all_round(past.seen.size(), past.increment);
        if (whole) beam %= count;
        if (!whole && (beam < 1 || beam > count - 2)) return false;
        const auto seen = [&](std::ptrdiff_t i) { return past.seen[(i + count) % count]; };
        const double free = std::min({seen(beam - 1), seen(beam), seen(beam + 1)});
        return free > std::sqrt(dx * dx + dy * dy) + kFree;
    };
    const auto past = std::span(past_).first(num_past_);
    const double enough = kCame * clusters_[cluster].count;
    int found = 0;
    for (std::size_t i = 0; i < scan.points.size() && found <= enough; ++i) {
        if (track_of_hit_[i] != cluster) continue;
        found += std::any_of(past.begin(), past.end(), [&](const Past &one) { return was_free(one, scan.points[i]); });
    }
    return found > enough;
}

void Tracker::remember(const PlacedScan &scan) {
    if (num_past_ == static_cast<int>(past_.size())) past_.emplace_back();
    Past &past = past_[num_past_++];
    past.stamp_s = scan.stamp_s;
    past.sensor = scan.sensor;
    past.angle_min = scan.angle_min;
    past.increment = scan.increment;
    past.seen.assign(scan.seen.begin(), scan.seen.end());
    while (past_[0].stamp_s < scan.stamp_s - kOver - kRounding) {
        std::rotate(past_.begin(), past_.begin() + 1, past_.begin() + num_past_);
        --num_past_;
    }
}

NearestTracks::NearestTracks(const TracksConfig &config) : config_(config) {
    for (int i = 0; i < config_.num_beams; ++i) {
        const double angle = config_.angle_min + i * config_.increment;
        directions_.push_back({std::cos(angle), std::sin(angle)});
    }
}

void NearestTracks::compute(std::span<const float *const> ranges, std::span<const Pose> poses, float *out) const {
    thread_local Tracker tracker;
    thread_local std::vector<double> seen;
    thread_local std::vector<int> beams;
    thread_local std::vector<Vec2> points;
    tracker.forget();
    double now_s = 0.0;
    for (std::size_t k = 0; k < ranges.size(); ++k) {
        const Pose sensor = compose(poses[k], config_.mount);
        const double c = std::cos(sensor.theta), s = std::sin(sensor.theta);
        seen.clear();
        beams.clear();
        points.clear();
        for (int i = 0; i < config_.num_beams; ++i) {
            const double range = ranges[k][i];
            const bool hit = range < config_.max_range;
            seen.push_back(hit ? range : config_.max_range); // not-a-number too
            if (!hit) continue;
            const Vec2 d = range * directions_[i];
            beams.push_back(i);
            points.push_back({sensor.x + c * d.x - s * d.y, sensor.y + s * d.x + c * d.y});
        }
        now_s = static_cast<double>(k) * config_.period_s;
        tracker.take({now_s, sensor, config_.angle_min, config_.increment, seen, beams, points});
    }
    const Pose here = poses.back();
    const auto away2 = [&](int k) {
        const Vec2 p = tracker.track(k).place() - Vec2{here.x, here.y};
        return dot(p, p);
    };
    thread_local std::vector<int> moving;
    moving.clear();
    for (int k = 0; k < tracker.count(); ++k) {
        if (tracker.track(k).moves(now_s)) moving.push_back(k);
    }
    std::sort(moving.begin(), moving.end(), [&](int a, int b) { return away2(a) < away2(b); });
    std::fill_n(out, config_.num_tracks * kNumbersOfTrack, 0.0F);
    const std::size_t told = std::min(moving.size(), static_cast<std::size_t>(config_.num_tracks));
    const double c = std::cos(here.theta), s = std::sin(here.theta);
    for (std::size_t k = 0; k < told; ++k) {
        const Track &track = tracker.track(moving[k]);
        const Vec2 p = track.place() - Vec2{here.x, here.y}, v = track.velocity();
        const double numbers[kNumbersOfTrack] = {c * p.x + s * p.y, c * p.y - s * p.x, c * v.x + s * v.y,
                                                 c * v.y - s * v.x, now_s - track.since_s()};
        std::copy(std::begin(numbers), std::end(numbers), out + k * kNumbersOfTrack);
    }
}

} // namespace adrl
