// The velocity of one disc among walls and others that move, by ORCA (orca.hpp): people walk by it, and a robot that is
// driven by ORCA.
#pragma once

#include "world/orca.hpp"
#include "world/world.hpp"

namespace adrl {

inline constexpr double kSight = 5.0;      // metres to the edge of what is avoided
inline constexpr int kMostNeighbours = 10; // the nearest

struct Avoiding { // who avoids, and how
    Mover self;   // its radius with the space that it leaves about itself
    double body;  // its radius without
    Vec2 preferred;
    double max_speed;
    double horizon_s, wall_horizon_s; // for which it avoids others, and walls
    double hold_s;                    // for which it keeps a velocity
};

// The nearest of what is offered, nearest first.
template <class T, int kMost>
struct Nearest {
    T item[kMost];
    double distance[kMost];
    int count = 0;
    void offer(const T &offered, double far) {
        if (count == kMost && far >= distance[kMost - 1]) return;
        int i = count < kMost ? count++ : kMost - 1;
        for (; i > 0 && distance[i - 1] > far; --i) {
            item[i] = item[i - 1];
            distance[i] = distance[i - 1];
        }
        item[i] = offered;
        distance[i] = far;
    }
};

// Those near a disc, and of the avoiding the part that the disc does.
class Neighbours {
  public:
    Neighbours(Vec2 at, double body) : at_(at), body_(body) {}
    void offer(const Mover &other, double share) {
        const double far = norm(other.at - at_) - other.radius - body_;
        if (far < kSight) nearest_.offer({other, share}, far);
    }

    struct Neighbour {
        Mover mover;
        double share;
    };
    std::span<const Neighbour> all() const { return {nearest_.item, static_cast<std::size_t>(nearest_.count)}; }

  private:
    Vec2 at_;
    double body_;
    Nearest<Neighbour, kMostNeighbours> nearest_;
};

// Of the allowed velocities the one nearest to the preferred one, among walls that are laid. Where walls leave none,
// and the least bad one would brush them, it stands.
Vec2 velocity_among(const World &world, const Avoiding &who, const Neighbours &others);

} // namespace adrl
