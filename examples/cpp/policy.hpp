// A trained policy in C++: the encoder of adrl.observation and the network, on the core's own motion cue.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "drive/collision.hpp"
#include "drive/kinematics.hpp"
#include "safetensors.hpp"
#include "world/motion_cue.hpp"
#include "world/tracker.hpp"

// A scan of the LiDAR the policy was trained with, and where odometry says the robot was.
struct Look {
    std::vector<float> ranges; // metres, one a beam
    adrl::Pose pose;
};

struct Action {
    float speed = 0.0F, turn = 0.0F; // in [-1, 1]
};

class Policy {
  public:
    // A file of `adrl export RUN --safetensors`.
    explicit Policy(const std::string &path) : Policy(Safetensors(path)) {}

    int num_beams() const { return static_cast<int>(lidar_[0]); }
    double angle_min() const { return lidar_[1]; }
    double angle_increment() const { return lidar_[2]; }
    adrl::Pose mount() const { return {lidar_[3], lidar_[4], lidar_[5]}; }
    double max_range() const { return lidar_[6]; }
    // Control periods between the two looks that motion cues compare; 0 for a policy without.
    int history_steps() const { return cue_ ? static_cast<int>(motion_[0]) : 0; }
    // Looks that tracks() takes, one each control period; 0 for a policy without.
    int num_followed() const { return tracks_ ? static_cast<int>(followed_[1]) + 1 : 0; }
    // How far ahead along the path the points lie that act() takes, metres; none for a policy that is told of no path.
    const std::vector<double> &path_points() const { return path_; }
    double period() const { return base_[0]; }  // of control, s
    double latency() const { return base_[4]; } // s
    adrl::DriveLimits drive_limits() const {
        return {limits_[0], limits_[1], limits_[2], base_[1], base_[2], base_[3]};
    }
    adrl::Footprint footprint() const {
        if (footprint_.size() == 1) return {footprint_[0], {}};
        adrl::Footprint polygon{0.0, {}};
        for (std::size_t i = 0; i < footprint_.size(); i += 2) {
            polygon.corners.push_back({footprint_[i], footprint_[i + 1]});
            polygon.radius = std::max(polygon.radius, adrl::norm(polygon.corners.back()));
        }
        return polygon;
    }

    // What act() is told of what moves, by the last num_followed() looks, the oldest first; NaN where anything in them
    // is no number. Throws std::invalid_argument for another number of looks or ranges.
    std::vector<float> tracks(std::vector<Look> looks) const {
        if (static_cast<int>(looks.size()) != num_followed())
            throw std::invalid_argument("this policy follows " + std::to_string(num_followed()) + " looks");
        if (!tracks_) return {};
        std::vector<float> told(adrl::kNumbersOfTrack * static_cast<std::size_t>(tracks_->num_tracks()));
        std::vector<const float *> ranges;
        std::vector<adrl::Pose> poses;
        for (Look &look : looks) {
            const bool placed = within<double>({look.pose.x, look.pose.y, look.pose.theta}, -kGreatest, kGreatest);
            if (!clip(look.ranges) || !placed) return std::vector<float>(told.size(), std::nanf(""));
            ranges.push_back(look.ranges.data());
            poses.push_back(look.pose);
        }
        tracks_->compute(ranges, poses, told.data());
        for (std::size_t k = 0; k < told.size(); k += adrl::kNumbersOfTrack) {
            const float away = std::hypot(told[k], told[k + 1]);
            const float nearness = std::max(1.0F - std::log1p(away / scales_[1]) * scales_[2], 0.0F);
            const float lasts = static_cast<float>(followed_[1] * base_[0]), fastest = adrl::kFastestMover;
            const float toward = nearness / std::max(away, 1e-6F);
            const float units[adrl::kNumbersOfTrack] = {toward, toward, 1.0F / fastest, 1.0F / fastest, 1.0F / lasts};
            for (std::size_t n = 0; n < adrl::kNumbersOfTrack; ++n)
                told[k + n] = std::clamp(told[k + n] * units[n], -1.0F, 1.0F);
        }
        return told;
    }

    // Ranges of the trained beams in their order, clipped to their reach; goal, path: in the robot's frame, metres, the
    // path being the points that path_points() asks for, all of them the goal where no path is known; twist: measured;
    // past: history_steps() control periods ago; tracks: those of tracks(). The action is NaN where anything is, or
    // anything but a range is beyond kGreatest: stop the robot. Throws std::invalid_argument for another number of
    // ranges or points.
    Action act(Look now, Look past, const std::vector<float> &tracks, adrl::Vec2 goal,
               const std::vector<adrl::Vec2> &path, adrl::Twist twist, Action last) const {
        if (path.size() != path_.size())
            throw std::invalid_argument("this policy takes " + std::to_string(path_.size()) + " points of the path");
        if (tracks.size() != tracks_size())
            throw std::invalid_argument("this policy takes " + std::to_string(tracks_size()) + " numbers of tracks");
        std::vector<double> told{goal.x, goal.y, twist.v, twist.w, last.speed, last.turn};
        if (cue_) {
            for (const adrl::Pose &pose : {now.pose, past.pose}) told.insert(told.end(), {pose.x, pose.y, pose.theta});
        }
        told.insert(told.end(), tracks.begin(), tracks.end());
        for (const adrl::Vec2 point : path) told.insert(told.end(), {point.x, point.y});
        const bool sound = clip(now.ranges) && (!cue_ || clip(past.ranges)) && within(told, -kGreatest, kGreatest);
        if (!sound) return {std::nanf(""), std::nanf("")};
        std::vector<float> x = sectors(now.ranges);
        const double distance = adrl::norm(goal), safe = std::max(distance, 1e-9);
        for (const double feature : {goal.x / safe, goal.y / safe, distance / (distance + scales_[3]),
                                     std::min(0.1 * distance, 1.0), twist.v / limits_[0], twist.w / limits_[2]}) {
            x.push_back(static_cast<float>(feature));
        }
        x.insert(x.end(), {last.speed, last.turn});
        if (cue_) {
            const std::size_t known = x.size();
            x.resize(known + extent_.size());
            cue_->compute(now.ranges.data(), now.pose, past.ranges.data(), past.pose, x.data() + known);
        }
        x.insert(x.end(), tracks.begin(), tracks.end());
        for (const adrl::Vec2 point : path) {
            const double shortened = adrl::norm(point) + scales_[3];
            x.insert(x.end(), {static_cast<float>(point.x / shortened), static_cast<float>(point.y / shortened)});
        }
        x.insert(x.end(), body_.begin(), body_.end());
        for (std::size_t k = 0; k < layers_.size(); ++k) x = layers_[k].apply(x, k + 1 < layers_.size());
        return {std::tanh(x[0]), std::tanh(x[1])};
    }

    adrl::Twist velocity(Action action) const {
        const double span = limits_[0] - limits_[1];
        return {limits_[1] + 0.5 * (action.speed + 1.0) * span, action.turn * limits_[2]};
    }

  private:
    struct Layer {
        std::vector<float> weight, bias; // weight (in, out)
        std::vector<float> apply(const std::vector<float> &x, bool relu) const {
            std::vector<float> y = bias;
            for (std::size_t i = 0; i < x.size(); ++i) {
                for (std::size_t o = 0; o < y.size(); ++o) y[o] += x[i] * weight[i * y.size() + o];
            }
            if (relu) {
                for (float &v : y) v = std::max(v, 0.0F);
            }
            return y;
        }
    };

    static constexpr double kGreatest = 1e6; // metres, m/s: a number beyond is a fault, as NaN is
    static constexpr double kLeast = 1e-6;   // of what is divided by
    static constexpr double kMostBeams = 100000, kMostSteps = 10000, kMostTracks = 1000;

    std::size_t tracks_size() const {
        return tracks_ ? adrl::kNumbersOfTrack * static_cast<std::size_t>(tracks_->num_tracks()) : 0;
    }

    explicit Policy(const Safetensors &file)
        : beams_(file.read<std::int32_t>("encoder.beams")), extent_(file.read<float>("encoder.extent")),
          scales_(file.read<float>("encoder.scales")), limits_(file.read<double>("limits")),
          lidar_(file.read<double>("lidar")), base_(file.read<double>("base")),
          footprint_(file.read<double>("footprint")) {
        check(file);
        for (int i = 0; file.has("layers." + std::to_string(i) + ".weight"); ++i) {
            const std::string name = "layers." + std::to_string(i);
            layers_.push_back({file.read<float>(name + ".weight"), file.read<float>(name + ".bias")});
        }
        if (file.has("motion")) {
            motion_ = file.read<double>("motion");
            if (motion_.size() != 3 || !whole(motion_[0], kMostSteps) || !within(motion_, 0.0, kGreatest) ||
                motion_[2] < kLeast) {
                file.fail("motion: three numbers, steps, margin and scale, are wanted");
            }
            cue_.emplace(adrl::CueConfig{num_beams(), angle_min(), angle_increment(), mount(), max_range(),
                                         static_cast<int>(extent_.size()), motion_[1], motion_[2]});
        }
        if (file.has("tracks")) {
            followed_ = file.read<double>("tracks");
            if (followed_.size() != 2 || !whole(followed_[0], kMostTracks) || !whole(followed_[1], kMostSteps))
                file.fail("tracks: two numbers, how many and steps, are wanted");
            tracks_.emplace(adrl::TracksConfig{num_beams(), angle_min(), angle_increment(), mount(), max_range(),
                                               period(), static_cast<int>(followed_[0])});
        }
        if (file.has("encoder.reach")) {
            reach_ = file.read<float>("encoder.reach");
            if (reach_.size() != 1 || !within(reach_, kLeast, kGreatest))
                file.fail("encoder.reach: one range is wanted");
        }
        if (file.has("encoder.path")) {
            path_ = file.read<double>("encoder.path");
            if (path_.size() > kMostBeams || !within(path_, 0.0, kGreatest))
                file.fail("encoder.path: metres ahead are wanted");
        }
        if (file.has("encoder.body")) {
            body_ = file.read<float>("encoder.body");
            if (!within(body_, -kGreatest, kGreatest)) file.fail("encoder.body holds what is no number");
        }
        std::size_t width = extent_.size() * (cue_ ? 2 : 1) + 8 + tracks_size() + 2 * path_.size() + body_.size();
        for (const Layer &layer : layers_) {
            if (layer.weight.size() != width * layer.bias.size()) file.fail("layers do not fit");
            if (!within(layer.weight, -kGreatest, kGreatest) || !within(layer.bias, -kGreatest, kGreatest)) {
                file.fail("layers hold what is no number");
            }
            width = layer.bias.size();
        }
        if (layers_.empty() || width != 2) file.fail("layers do not end in speed and yaw rate");
    }

    // Everything that is divided by, counted with or looked up: sizes and ranges.
    void check(const Safetensors &file) const {
        if (lidar_.size() != 7 || !whole(lidar_[0], kMostBeams) || !within(lidar_, -kGreatest, kGreatest) ||
            lidar_[2] < kLeast || lidar_[6] < kLeast) {
            file.fail("lidar: beams, angles, mount and a range above 0 are wanted");
        }
        if (limits_.size() != 3 || !within(limits_, -kGreatest, kGreatest) || limits_[0] < kLeast ||
            limits_[1] >= limits_[0] || limits_[2] < kLeast) {
            file.fail("limits: greatest and least speed and greatest yaw rate are wanted");
        }
        if (base_.size() != 5 || !within(base_, 0.0, kGreatest) || base_[0] <= 0.0) {
            file.fail("base: period, accelerations, lag and latency are wanted");
        }
        if (scales_.size() != 4 || !within(scales_, kLeast, kGreatest)) {
            file.fail("encoder.scales: four numbers above 0 are wanted");
        }
        if (!within(extent_, 0.0, kGreatest) || extent_.size() > kMostBeams || beams_.size() % extent_.size() != 0 ||
            !within(beams_, 0.0, lidar_[0])) {
            file.fail("encoder: a distance and the numbers of its beams are wanted of each sector");
        }
        const bool outlined = footprint_.size() == 1 || (footprint_.size() >= 6 && footprint_.size() % 2 == 0);
        if (!outlined || !within(footprint_, -kGreatest, kGreatest) ||
            (footprint_.size() == 1 && footprint_[0] <= 0.0)) {
            file.fail("footprint: a radius above 0 or three corners and more are wanted");
        }
    }

    // NaN is within nothing.
    template <class T>
    static bool within(const std::vector<T> &values, double least, double greatest) {
        return std::ranges::all_of(values, [&](T value) { return value >= least && value <= greatest; });
    }

    static bool whole(double value, double greatest) {
        return value >= 1.0 && value <= greatest && value == std::floor(value);
    }

    // Whether all are numbers.
    bool clip(std::vector<float> &ranges) const {
        if (ranges.size() != static_cast<std::size_t>(num_beams())) {
            throw std::invalid_argument("a scan has " + std::to_string(ranges.size()) + " ranges, this policy takes " +
                                        std::to_string(num_beams()));
        }
        for (float &range : ranges) {
            if (std::isnan(range)) return false;
            range = std::clamp(range, 0.0F, scales_[0]);
        }
        return true;
    }

    // Nearest range of each sector, 0 at contact, on a logarithmic scale.
    std::vector<float> sectors(const std::vector<float> &ranges) const {
        const std::size_t most = beams_.size() / extent_.size();
        std::vector<float> out;
        for (std::size_t s = 0; s < extent_.size(); ++s) {
            float nearest = scales_[0];
            for (std::size_t k = 0; k < most; ++k) {
                const auto beam = static_cast<std::size_t>(beams_[s * most + k]);
                if (beam < ranges.size()) nearest = std::min(nearest, ranges[beam]);
            }
            if (!reach_.empty()) nearest = nearest < scales_[0] ? std::min(nearest, reach_[0]) : reach_[0];
            const float gap = std::max(nearest - extent_[s], 0.0F);
            out.push_back(std::log1p(gap / scales_[1]) * scales_[2]);
        }
        return out;
    }

    std::vector<std::int32_t> beams_;
    std::vector<float> extent_, scales_;
    std::vector<float> reach_, body_; // of a policy of many robots: where its scale of ranges ends, what its robot is
    std::vector<double> limits_, lidar_, base_, footprint_, motion_, followed_, path_;
    std::vector<Layer> layers_;
    std::optional<adrl::MotionCue> cue_;
    std::optional<adrl::NearestTracks> tracks_;
};
