// Distance from a footprint to the geometry the LiDAR sees, and motion that cannot pass through it.
#pragma once

#include <vector>

#include "world/geometry.hpp"
#include "world/moving.hpp"

namespace adrl {

struct Footprint {
    double radius = 0.2;       // of the disc; of the circumscribed disc for a polygon
    std::vector<Vec2> corners; // convex polygon, counter-clockwise; empty for a disc
    bool is_disc() const { return corners.empty(); }
};

inline constexpr int kMaxCorners = 16;

// Distance from the footprint's edge to the nearest obstacle, at most `limit`; 0 or less when they overlap.
double clearance(const World &world, const DiscPlaces &discs, const Footprint &footprint, const Pose &pose,
                 double limit);

// Distance from the footprint's edge to a point in the robot's frame; 0 or less, of a polygon 0, when it is inside.
double distance_to_point(const Footprint &footprint, Vec2 point);

// Distance from the footprint's edge to the segment a-b in the robot's frame; 0 or less, of a polygon 0, where they
// meet.
double distance_to_segment(const Footprint &footprint, Vec2 a, Vec2 b);

// Whether a disc can slide along the straight line from a to b without touching anything that stands still.
bool corridor_free(const World &world, Vec2 from, Vec2 to, double radius);

// Distance in metres from a point to the bitmap's solid cells, at most `limit`; 0 in a solid cell.
double point_to_bitmap(const Bitmap &bitmap, Vec2 point, double limit);

struct Motion {
    Pose pose;              // where the robot ended: at the end of the step or where it hit
    double moved_s = 0.0;   // time until then
    double clearance = 0.0; // least seen on the way
    bool collided = false;
    double final_clearance = 0.0;
    bool at_fault = false; // collided, and moved into what it touches: a moment ago on its own way there was more room
};

// Drives an arc of constant twist for dt from time_s, stopping at the first contact. Conservative advancement: from
// clearance c nothing can be hit before c / (fastest closing speed), so nothing is passed through at any speed;
// contacts are found to within kContact metres.
inline constexpr double kContact = 1e-3;
Motion drive(const Moving &moving, const Footprint &footprint, const Pose &pose, const Twist &twist, double time_s,
             double dt_s, double start_clearance, double limit);

} // namespace adrl
