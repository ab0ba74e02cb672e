// The maps and routes of N robots that know only what they have scanned. All that changes lies in the caller's arrays.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "planning/car_route.hpp"
#include "planning/occupancy.hpp"
#include "planning/route_planner.hpp"
#include "planning/waypoint.hpp"
#include "stock.hpp"
#include "thread_pool.hpp"

namespace adrl {

// Of robots of one kind. Those side by side have windows of one shape, and costs that differ in clearances alone.
struct ReplannerSetup {
    WindowShape shape;
    Beams beams{1, 0.0, 0.0};
    Evidence evidence;
    Pose mount; // of the LiDAR, in the robot's frame
    double max_range = 6.0;
    double reach = 6.0;       // hits farther away are not mapped
    double body_radius = 0.2; // of a disc that the footprint covers: free, as the robot stands there
    RouteCosts costs;
    WaypointRules waypoint;
    std::optional<Car> car; // whose routes are curves that it can steer
};

// Row i belongs to robot i.
struct ReplannerBuffers {
    const std::int64_t *kind; // (N) what each robot is, by its number
    int num_columns;          // K of the scans, the most beams of any kind
    std::int8_t *log_odds;    // (N, H, W)
    std::int64_t *origin;     // (N, 2) lattice row, column of each window
    std::uint8_t *parity;     // (N) which half of the beams the next scan traces
    double *waypoint;         // (N, 2) where to head for, metres
    double *route;            // (N) metres of route from the robot to its end
    std::uint8_t *found;      // (N) 0 no route, 1 to the goal, 2 towards it, 3 through what may go: see Route
};

inline constexpr double kRouteWindow = 3.0; // a robot is looked for so far ahead of where it was on its route, metres
inline constexpr int kRouteCorners = 64;    // of a route, at most; a longer one is cut off

// Routes pulled taut, from the robots to their ends.
struct RouteCorners {
    double *points;      // (N, kRouteCorners, 2) metres
    std::int32_t *count; // (N)
    std::span<const double> of(int i) const {
        return {points + static_cast<std::ptrdiff_t>(i) * 2 * kRouteCorners, 2 * static_cast<std::size_t>(count[i])};
    }
};

class Replanner {
  public:
    Replanner(int num_robots, int num_threads, const std::vector<ReplannerSetup> &setups, ReplannerBuffers buffers);

    int num_robots() const { return num_robots_; }
    int num_columns() const { return b_.num_columns; }
    std::size_t num_kinds() const { return kinds_.size(); }
    const std::int64_t *kinds() const { return b_.kind; }
    ThreadPool &pool() { return pool_; }
    const WindowShape &shape() const { return shape_; }
    const std::int8_t *window(int i) const { return cells(i); }
    WindowOrigin origin(int i) const { return {b_.origin[2 * i], b_.origin[2 * i + 1]}; }
    // Forgets what the robots of the mask (N) have seen and puts them, at poses (N, 3), in their windows' middles.
    void restart(const std::uint8_t *mask, const double *pose);
    // Enters scans (N, K) taken at poses (N, 3).
    void observe(const std::uint8_t *mask, const double *pose, const float *ranges);
    // Plans to goals (N, 2): waypoint, route and found, and the routes themselves where they are wanted.
    void plan(const std::uint8_t *mask, const double *pose, const double *goal, const RouteCorners *routes = nullptr);
    // Writes into out (N, kPathAhead, 2) points of robots' routes ahead of where they are, poses (N, 3). along (N): how
    // far along its route each has come; 0 for a new one.
    void ahead(const std::uint8_t *mask, const double *pose, const RouteCorners &routes, double *along, double *out);
    // out (N): whether the straight line from the robot towards a point (N, 2) is free of what has been seen, for at
    // most `distance` metres of it; with `known`, also whether all of that line has been seen. Robots off the mask are
    // left alone.
    void see(const std::uint8_t *mask, const double *pose, const double *point, double distance, bool known,
             std::uint8_t *out);

  private:
    struct Kind {
        Scanner scanner;
        RouteCosts costs;
        WaypointRules waypoint;
        std::optional<CarModel> car;
    };
    struct Scratch {
        ScanIntegrator integrator;
        RoutePlanner planner;
        std::unique_ptr<CarRoute> car; // where there are cars
        Path route;
    };

    void plan_one(int i, Scratch &scratch, const Pose &pose, Vec2 goal, const RouteCorners *routes);
    std::int8_t *cells(int i) const { return b_.log_odds + static_cast<std::size_t>(i) * shape_.height * shape_.width; }
    void store_origin(int i, const WindowOrigin &o) {
        b_.origin[2 * i] = o.row;
        b_.origin[2 * i + 1] = o.column;
    }

    const Kind &kind_of(int i) const { return kinds_[static_cast<std::size_t>(b_.kind[i])]; }

    int num_robots_;
    WindowShape shape_;
    std::vector<Kind> kinds_;
    ReplannerBuffers b_;
    ThreadPool pool_;
    Stock<Scratch> stock_; // one a thread
};

} // namespace adrl
