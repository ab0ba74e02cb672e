// What exists: circles, convex polygons, segments, moving discs and a bitmap of solid cells. Immutable once built.
#pragma once

#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "clones.hpp"
#include "world/crowd.hpp"
#include "world/geometry.hpp"

namespace adrl {

// Kernels read obstacles in blocks of this many; arrays are padded to it with obstacles far away.
inline constexpr int kLanes = 8;
inline constexpr double kFarAway = 1e9;

struct Circles { // structure of arrays, padded
    std::vector<double> x, y, radius;
    int count = 0;
    void add(double cx, double cy, double r);
    void pad();
};

struct Segments { // structure of arrays, padded
    std::vector<double> ax, ay, bx, by;
    int count = 0;
    void add(Vec2 a, Vec2 b);
    void pad();
};

struct Boxes { // axis-aligned, structure of arrays, padded
    std::vector<double> x_min, x_max, y_min, y_max;
};

// A disc that runs to and fro between two ends at constant speed. Its position depends on time alone.
struct MovingDisc {
    Vec2 from, to;
    double radius = 0.0;
    double speed = 0.0;
    double phase = 0.0;  // part of the round trip done at time 0, in [0, 1)
    double stop_s = 0.0; // stands still from then on
    Vec2 at(double time_s) const;
    Vec2 velocity(double time_s) const; // mean over the next moment
};

// Solid cells with the tables that make rays and distances quick.
struct Bitmap {
    int height = 0;
    int width = 0;
    double resolution = 1.0;
    Pose origin; // lower left corner of cell (0, 0)
    double cos_theta = 1.0;
    double sin_theta = 0.0;
    std::vector<std::uint8_t> solid;
    std::vector<std::uint8_t> jump; // chebyshev_field of solid
    std::vector<float> distance;    // distance_field of solid, in cells

    bool empty() const { return solid.empty(); }
    // A world point in cells, measured from the origin along the bitmap's axes.
    Vec2 to_cells(Vec2 p) const;
    Vec2 to_world(Vec2 cells) const;
};

class World {
  public:
    // Arrays as in adrl.types.World; solid is row-major and may be null when height or width is 0.
    World(std::span<const double> circles, std::span<const double> corners, std::span<const std::int32_t> offsets,
          std::span<const double> segments, std::span<const double> discs, const std::uint8_t *solid, int height,
          int width, double resolution, Pose origin);

    const Circles &circles() const { return circles_; }
    const Segments &walls() const { return walls_; }
    // Edges of all polygons, counter-clockwise; polygon p owns edges [polygon_begin()[p], polygon_begin()[p + 1]).
    const Segments &edges() const { return edges_; }
    const std::vector<int> &polygon_begin() const { return polygon_begin_; }
    const Boxes &polygon_boxes() const { return polygon_boxes_; }
    const std::vector<MovingDisc> &discs() const { return discs_; }
    const Bitmap &bitmap() const { return bitmap_; }
    double max_disc_speed() const { return max_disc_speed_; }
    // The same geometry for who avoids walls by ORCA, only after lay_walls(). Once laid, laying them does nothing.
    void lay_walls() const;
    const Walls &laid_walls() const { return laid_walls_; }

  private:
    Circles circles_;
    Segments walls_;
    Segments edges_;
    std::vector<int> polygon_begin_;
    Boxes polygon_boxes_;
    std::vector<MovingDisc> discs_;
    Bitmap bitmap_;
    double max_disc_speed_ = 0.0;
    mutable std::once_flag laid_;
    mutable Walls laid_walls_;
};

// Whether a point is inside one of the world's polygons, or on its border.
bool inside_polygon(const World &world, Vec2 p);

// At most this many moving discs and people about a robot; their places at one instant fit on the stack.
inline constexpr int kMaxDiscs = 64;

} // namespace adrl
