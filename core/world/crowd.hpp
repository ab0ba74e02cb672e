// Who walks in a task, where to, and the walls that walkers keep off. Immutable once built.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "world/geometry.hpp"

namespace adrl {

// At most this many people a task; with the moving discs of its world together at most kMaxDiscs.
inline constexpr int kMaxPeople = 64;

struct Walker {
    double radius = 0.3;
    double speed = 1.2;      // preferred; 0 stands
    double share = 0.5;      // of avoiding the robot: 0 does not look, 1 leaves the robot nothing to do
    double reaction_s = 0.1; // time between two decisions
    int group = -1;          // people of one number keep together; -1 walks alone
    bool blind = false;      // walks on along its route, whatever is in the way
    int first = 0, last = 0; // its route: the way points [first, last), walked to and fro
};

struct Crowd {
    std::vector<Walker> walkers;
    std::vector<Vec2> way_points;
    bool legs = false; // a LiDAR sees two legs instead of the body
    int count() const { return static_cast<int>(walkers.size()); }
};

// What changes of one person: a row of numbers in the caller's array.
struct Person {
    double x, y, vx, vy;
    double heading; // of the latest steps, radians
    double walked;  // metres
    double goal;    // index on its route of the point it heads for
    double onward;  // 1 to the route's end, -1 back
    double wait_s;  // until the next decision
    double held_s;  // how long it has hardly moved
};
inline constexpr int kPersonNumbers = 10;
static_assert(sizeof(Person) == kPersonNumbers * sizeof(double));

// A straight piece of wall: solid on its left, people are on its right. A wall without thickness is two of them.
struct WallEdge {
    Vec2 a, b;
    int before = 0, after = 0; // edges that end in a and begin in b
    bool convex = true;        // the corner at a
    Vec2 direction() const { return (1.0 / norm(b - a)) * (b - a); }
};

// Edges by place.
class Walls {
  public:
    static constexpr double kReach = 2.5; // metres; edges beyond are not found

    Walls() = default;
    explicit Walls(std::vector<WallEdge> edges);

    const WallEdge &operator[](int i) const { return edges_[i]; }
    int count() const { return static_cast<int>(edges_.size()); }
    // Edges that may lie within kReach of p.
    std::span<const std::int32_t> near(Vec2 p) const;

  private:
    std::vector<WallEdge> edges_;
    Vec2 corner_;
    double cell_ = 1.0;
    int width_ = 0, height_ = 0;
    std::vector<std::int32_t> begin_, listed_;
};

struct Segments;
struct Bitmap;
// Walls of all that stands: polygons (edges of each in a row), thin walls and outlines of solid cells.
std::vector<WallEdge> wall_edges(const Segments &polygon_edges, const std::vector<int> &polygon_begin,
                                 const Segments &thin, const Bitmap &bitmap);

} // namespace adrl
