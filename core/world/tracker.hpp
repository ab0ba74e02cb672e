// What moves about a LiDAR: clusters of hits, followed from scan to scan in a frame in which the world stands.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "world/geometry.hpp"

namespace adrl {

inline constexpr double kFastestMover = 2.0; // m/s

// A scan and where its hits are.
struct PlacedScan {
    double stamp_s = 0.0;
    Pose sensor;
    double angle_min = 0.0, increment = 0.0; // of the beams in the sensor's frame; the increment has either sign
    std::span<const double> seen;            // (K) metres that each beam has passed; 0 where it tells nothing
    std::span<const int> beams;              // (H) those that have hit something, rising
    std::span<const Vec2> points;            // (H) what they have hit
};

// One cluster, for as long as it is seen, but for moments.
class Track {
  public:
    Vec2 place() const { return places_[at(count_ - 1)].point; }
    Vec2 velocity() const { return velocity_; }
    double since_s() const { return since_s_; }
    double breadth() const { return breadth_; } // across the hits of the last scan
    // Whether it moves, or has done so until a moment ago; and whether it was seen to so often that it was no noise.
    bool moves(double now_s) const;
    bool has_moved() const { return moved_ >= kSure; }

  private:
    friend class Tracker;
    static constexpr int kMostPlaces = 32;
    static constexpr int kSure = 3; // scans
    struct Place {
        double stamp_s;
        Vec2 point;
    };

    void begin(double now_s, Vec2 point);
    void add(double now_s, Vec2 point);
    // Measures the velocity by the line through its places; false where they span too little time.
    bool measure();
    int at(int k) const { return (first_ + k) % kMostPlaces; }
    double last_s() const { return places_[at(count_ - 1)].stamp_s; }

    int first_ = 0, count_ = 0; // of places, a ring, the newest last
    int moved_ = 0;             // scans in which it was seen to move
    Vec2 velocity_;
    double since_s_ = 0.0, moved_s_ = 0.0, breadth_ = 0.0;
    Place places_[kMostPlaces];
};

// A cluster moves when it is elsewhere than a while ago, and some of its hits lie where an earlier scan saw free space:
// what comes into view behind something else seems to move, too, but nobody has seen that its place was free.
class Tracker {
  public:
    // The frame is another now.
    void forget();

    // The next scan. One that is no newer than the last begins anew.
    void take(const PlacedScan &scan);

    // (H) which of tracks() the hits of the last scan are of; -1 of what is too wide to be followed.
    std::span<const int> track_of_hit() const { return track_of_hit_; }
    // Of the clusters in the last scan.
    int count() const { return static_cast<int>(live_.size()); }
    const Track &track(int k) const { return pool_[live_[k]]; }

  private:
    struct Past {
        double stamp_s = 0.0;
        Pose sensor;
        double angle_min = 0.0, increment = 0.0;
        std::vector<double> seen;
    };

    struct Cluster {
        Vec2 low, high, sum; // of the points of its hits
        int count = 0;
    };

    void cluster(const PlacedScan &scan);
    int follow(double now_s, Vec2 point);
    bool came(const PlacedScan &scan, int cluster) const;
    void remember(const PlacedScan &scan);

    std::vector<Track> pool_;
    std::vector<int> live_, lost_, unused_; // numbers in the pool
    std::vector<Past> past_;                // the first num_past_, the oldest first
    int num_past_ = 0;
    std::vector<Cluster> clusters_;
    std::vector<int> track_of_hit_; // a cluster's track has its number
};

// A robot's LiDAR, and how many tracks are told.
struct TracksConfig {
    int num_beams = 1;
    double angle_min = 0.0;
    double increment = 0.0;
    Pose mount;
    double max_range = 6.0;
    double period_s = 0.1; // between two scans
    int num_tracks = 1;
};

inline constexpr int kNumbersOfTrack = 5;

// The nearest tracks that move, by the last scans of a robot.
class NearestTracks {
  public:
    explicit NearestTracks(const TracksConfig &config);

    int num_beams() const { return config_.num_beams; }
    int num_tracks() const { return config_.num_tracks; }
    // ranges (num_beams) of each scan and the robot's poses at it, the oldest first -> out (num_tracks, 5), the nearest
    // first: place and velocity in the robot's frame as it is now, and for how many seconds it has been followed;
    // zeros where there are no more.
    void compute(std::span<const float *const> ranges, std::span<const Pose> poses, float *out) const;

  private:
    TracksConfig config_;
    std::vector<Vec2> directions_; // of the beams, in the sensor's frame
};

} // namespace adrl
