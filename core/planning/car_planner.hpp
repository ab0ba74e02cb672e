// Paths that a car can drive, forward and backward: hybrid A* with Reeds-Shepp curves (Dolgov et al. 2008).
#pragma once

#include <cstdint>
#include <vector>

#include "drive/collision.hpp"
#include "drive/footprint_balls.hpp"
#include "planning/reeds_shepp.hpp"

namespace adrl {

struct Car {
    Footprint footprint;
    double turning_radius = 0.5;
    bool backward = true;
    double margin = 0.1; // metres kept from obstacles; cells that are near the start have what the start has
};

// What the planner knows of a car on cells of one size, made once.
struct CarModel {
    CarModel(const Car &car, double resolution);

    Car car;
    std::vector<Ball> balls; // of the footprint
    double inner;            // radius of the greatest disc about the origin in the footprint
    double step, arc;        // metres of a line and of an arc of the search
    double check;            // metres between two poses that are looked at
};

// A grid of clearances: metres from cells' centres to the nearest obstacle. What lies outside is not free.
struct ClearanceGrid {
    const float *clearance; // (H, W)
    Vec2 origin;            // lower left corner of cell (0, 0)
};

// Plans on grids of one size. Owns its scratch; a plan allocates nothing.
class CarPlanner {
  public:
    CarPlanner(int height, int width, double resolution, int most_poses = kMostPoses);

    // Whether there is a path from a pose to a point, with any heading there. The search is over poses at the ends of
    // short arcs and lines, one a cell and heading; its estimates are the ways on the grid from the goal of a disc that
    // fits into the footprint, and Reeds-Shepp curves lead from it to the goal. What it finds is then pulled taut by
    // such curves. Equal inputs give equal paths.
    bool plan(const CarModel &model, const ClearanceGrid &grid, const Pose &start, Vec2 goal);

    // Of the last plan that found one: its corners, with arcs as chords of at most kSpacing. Where it turns back the
    // chords do, by 180 degrees but for the curvature.
    const std::vector<Pose> &poses() const { return poses_; }
    int expanded() const { return expanded_; } // poses that the search has left

    static constexpr double kSpacing = 0.1;
    static constexpr int kMostPoses = 1 << 18; // of a search, before it gives up
    static constexpr int kMostCorners = 1 << 14;

  private:
    struct Node {
        Pose pose;
        double g;            // metres with the costs of gears
        CarPiece piece;      // that ends there; of no length for the start
        std::int32_t parent; // -1 for the start
        bool closed;
    };
    struct Open {
        double f;
        std::int32_t node;
    };
    struct Slot { // of the hash table
        std::uint32_t stamp, key;
        std::int32_t node;
    };
    struct Anchor { // of the path that is pulled taut: a pose, and what the way to it costs
        Pose pose;
        double cost;
        CarPiece piece; // that ends there
    };

    bool free_at(const Pose &pose) const;
    double slack_at(const Pose &pose) const;
    float clearance_at(double x, double y) const;
    bool drives_free(const Pose &from, const CarPiece &piece) const;
    bool curve_free(const Pose &from, const CarCurve &curve) const;
    void measure_distances();
    double estimate(const Pose &pose) const;
    std::uint32_t key_of(const Pose &pose) const;
    Slot &slot_of(std::uint32_t key);
    void reach(const Pose &pose, double g, std::int32_t parent, const CarPiece &piece);
    void expand(std::int32_t index);
    bool curve_to_goal(const Pose &from, int gear, double most, CarCurve &curve) const;
    bool search();
    void trace();
    void pull_taut();
    void add(const CarCurve &curve);

    int height_, width_;
    double resolution_;
    int coarse_height_, coarse_width_;
    double coarse_; // side of a cell of the search, metres
    std::size_t most_poses_;

    const CarModel *model_ = nullptr; // of the plan at hand
    ClearanceGrid grid_{};
    Vec2 goal_;
    Pose start_;
    double start_slack_ = 0.0;
    std::vector<float> distance_; // (coarse_height_, coarse_width_) metres to the goal on the grid
    std::vector<std::uint8_t> passable_;
    std::vector<Open> heap_, cells_heap_;
    std::vector<Node> nodes_;
    std::vector<Slot> table_;
    std::uint32_t stamp_ = 0;
    int expanded_ = 0;
    std::int32_t last_ = -1; // node from which the best curve leads to the goal
    CarCurve end_;
    std::vector<Anchor> anchors_;
    std::vector<Pose> poses_;
};

} // namespace adrl
