#include "world/avoidance.hpp"

#include <algorithm>

namespace adrl {
namespace {

constexpr double kBrush = 0.02; // metres by which a body may brush a wall
constexpr int kMostWalls = 32;

using NearWalls = Nearest<int, kMostWalls>; // edges, and circles as ~index

NearWalls near_walls(const World &world, const Mover &self) {
    NearWalls out;
    const double reach = Walls::kReach;
    const Walls &walls = world.laid_walls();
    for (const int i : walls.near(self.at)) {
        const Vec2 a = walls[i].a - self.at, b = walls[i].b - self.at;
        if (cross(a, b) >= 0.0) continue; // seen from behind
        const double far = origin_to_segment(a, b);
        if (far < reach) out.offer(i, far);
    }
    const Circles &circles = world.circles();
    for (int i = 0; i < circles.count; ++i) {
        const double far = norm(Vec2{circles.x[i], circles.y[i]} - self.at) - circles.radius[i];
        if (far < reach) out.offer(~i, far);
    }
    return out;
}

Mover circle(const World &world, int wall) {
    const Circles &circles = world.circles();
    return {{circles.x[~wall], circles.y[~wall]}, {}, circles.radius[~wall]};
}

// Whether a step of this length would come nearer to a wall than the body allows, and nearer than it is.
bool brushes(const World &world, const NearWalls &near, const Avoiding &who, Vec2 step) {
    const Vec2 at = who.self.at;
    for (int i = 0; i < near.count; ++i) {
        const int wall = near.item[i];
        double far = 0.0;
        if (wall >= 0) {
            const WallEdge &edge = world.laid_walls()[wall];
            far = segment_to_segment(at, at + step, edge.a, edge.b);
        } else {
            const Mover other = circle(world, wall);
            far = origin_to_segment(at - other.at, at + step - other.at) - other.radius;
        }
        if (far < who.body - kBrush && far < near.distance[i] - 1e-9) return true;
    }
    return false;
}

} // namespace

Vec2 velocity_among(const World &world, const Avoiding &who, const Neighbours &others) {
    HalfPlane planes[kMostHalfPlanes];
    int hard = 0;
    const NearWalls walls = near_walls(world, who.self);
    for (int i = 0; i < walls.count; ++i) {
        const int wall = walls.item[i];
        const std::span<const HalfPlane> before(planes, static_cast<std::size_t>(hard));
        if (wall < 0) {
            planes[hard++] = avoid_mover(who.self, circle(world, wall), 1.0, who.wall_horizon_s, who.hold_s);
        } else if (avoid_wall(who.self, world.laid_walls(), wall, who.wall_horizon_s, before, planes[hard])) {
            ++hard;
        }
    }
    int count = hard;
    for (const auto &[mover, share] : others.all()) {
        planes[count++] = avoid_mover(who.self, mover, share, who.horizon_s, who.hold_s);
    }
    const Vec2 chosen = nearest_allowed({planes, static_cast<std::size_t>(count)}, hard, who.max_speed, who.preferred);
    // Where walls leave no velocity at all, the least bad one may lead into them.
    const bool outside =
        std::any_of(planes, planes + hard, [&](const HalfPlane &p) { return p.excess(chosen) > 1e-6; });
    return outside && brushes(world, walls, who, who.hold_s * chosen) ? Vec2{} : chosen;
}

} // namespace adrl
