// Whether a robot that is told to stop comes to rest without touching what its LiDAR has seen.
#pragma once

#include <span>

#include "drive/collision.hpp"
#include "drive/kinematics.hpp"

namespace adrl {

// A command and how long the base acts on it.
struct Order {
    Twist twist;
    double duration_s = 0.0;
};

// Where a LiDAR has hit something, in the robot's frame, and the clearance that it has to keep.
struct Hit {
    Vec2 point;
    double margin = 0.0;
};

// The same of something that moves: it may stop wherever it comes at this velocity, and what it has left counts, too.
struct MovingHit {
    Hit seen;
    Vec2 velocity;
    double age_s = 0.0; // since it was there
};

struct DriveState {
    Pose pose;
    Twist twist;
};

class Braking {
  public:
    // limits: of the base's own response to commands; dt_s: its control period.
    Braking(Footprint footprint, DriveLimits limits, double dt_s)
        : footprint_(std::move(footprint)), limits_(limits), dt_s_(dt_s) {}

    // The state after the orders, moved as the simulator moves robots: period by period, each at its mean twist.
    DriveState roll(DriveState state, std::span<const Order> orders) const;

    // Whether a robot at the origin that executes the orders and then brakes keeps every hit at least its margin away;
    // a hit nearer than that already only has to come no nearer, and one inside the footprint, which is the robot
    // itself or already touched, is passed over. hits is sorted out in place: only those within reach are left in
    // front.
    //
    // Nor may the robot, as long as it moves, come nearer by its own motion to what moves once that is within its
    // margin. What comes up to a robot that stands, turns away or drives off is no reason to stand.
    bool stays_clear(Twist twist, std::span<const Order> orders, std::span<Hit> hits,
                     std::span<const MovingHit> moving = {}) const;

  private:
    template <class Visit>
    bool drive_on(DriveState &state, const Order &order, Visit visit) const;
    double reach(Twist twist, std::span<const Order> orders) const;

    Footprint footprint_;
    DriveLimits limits_;
    double dt_s_;
};

} // namespace adrl
