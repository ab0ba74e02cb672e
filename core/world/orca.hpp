// Optimal reciprocal collision avoidance (van den Berg, Guy, Lin, Manocha 2011): half-planes of velocities, and the
// velocity in all of them that is nearest to the preferred one.
#pragma once

#include <span>

#include "world/crowd.hpp"
#include "world/geometry.hpp"

namespace adrl {

// Velocities on the left of a line, or on it, are allowed. direction has length 1.
struct HalfPlane {
    Vec2 point, direction;
    // How far outside a velocity is, m/s; 0 or less inside.
    double excess(Vec2 velocity) const { return cross(direction, point - velocity); }
};

struct Mover { // a disc that moves
    Vec2 at, velocity;
    double radius = 0.0;
};

// Velocities of `self` that avoid `other` for horizon_s when self does `share` of what is to be done. step_s: within
// this time a touch is to be ended.
HalfPlane avoid_mover(const Mover &self, const Mover &other, double share, double horizon_s, double step_s);

// Velocities that keep off a wall for horizon_s, into `out`. False where none are forbidden that `before`, half-planes
// of nearer walls, do not forbid.
bool avoid_wall(const Mover &self, const Walls &walls, int edge, double horizon_s, std::span<const HalfPlane> before,
                HalfPlane &out);

// The velocity of at most max_speed in all half-planes nearest to the preferred one (Section 5.1 there). Where there is
// none, the one that violates those after the first `hard`, which are of walls, least (Section 5.3). At most
// kMostHalfPlanes.
inline constexpr int kMostHalfPlanes = 64;
Vec2 nearest_allowed(std::span<const HalfPlane> planes, int hard, double max_speed, Vec2 preferred);

} // namespace adrl
