// What every local controller is told, and what it answers. Each kind is a file beside this one.
#pragma once

#include "control/near_obstacles.hpp"
#include "drive/collision.hpp"
#include "drive/kinematics.hpp"
#include "planning/path.hpp"

namespace adrl {

// One robot at one instant. Pose, path and obstacles are in one frame: the world's, or that of the robot's odometry.
struct Situation {
    NearObstacles &obstacles; // gathered within the controller's reach; the controller may place moving discs in it
    const Footprint &footprint;
    const DriveLimits &limits;
    Pose pose;
    Twist twist; // as the base executes it
    const Path &path;
    double along;         // arc length of the path's point nearest to the robot
    double stop;          // up to which it is followed: its end, for a car the next cusp
    double gear;          // 1 to follow it forward, -1 backward, which only cars do
    double dt_s;          // control period
    const Moving *moving; // what moves in a known world; null on a map of the robot's own
    double time_s;        // of this instant in that world
};

class LocalController {
  public:
    virtual ~LocalController() = default;
    // How far from the robot's position obstacles matter, metres.
    virtual double reach(const Footprint &footprint, const DriveLimits &limits, double dt_s) const = 0;
    // The command for the next control period, within the limits. memory: what it remembers of this robot from one
    // decision to the next, all 0 for one that has just started; how many numbers its constants tell. Owns scratch, so
    // one thread at a time; the same situation and memory give the same bytes.
    virtual Twist command(const Situation &now, double *memory) = 0;
};

} // namespace adrl
