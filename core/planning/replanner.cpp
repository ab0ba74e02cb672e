#include "planning/replanner.hpp"

#include <algorithm>
#include <cmath>

#include "planning/path_guide.hpp"

namespace adrl {
namespace {

Pose pose_at(const double *poses, int i) { return {poses[3 * i], poses[3 * i + 1], poses[3 * i + 2]}; }

Vec2 point_at(const double *points, int i) { return {points[2 * i], points[2 * i + 1]}; }

Cell cell_of(Vec2 p, const WindowShape &shape, const WindowOrigin &origin) {
    // Far goals are brought near enough for an int; the direction to them stays.
    const auto index = [&](double metres, std::int64_t first) {
        const double at = std::floor(metres / shape.resolution) - static_cast<double>(first);
        return static_cast<int>(std::clamp(at, -1e6, 1e6));
    };
    return {index(p.y, origin.row), index(p.x, origin.column)};
}

} // namespace

Replanner::Replanner(int num_robots, int num_threads, const std::vector<ReplannerSetup> &setups,
                     ReplannerBuffers buffers)
    : num_robots_(num_robots), shape_(setups.front().shape), b_(buffers), pool_(num_threads) {
    RouteCosts widest = setups.front().costs; // room for it is room for all
    for (const ReplannerSetup &one : setups) {
        kinds_.push_back({Scanner(one.evidence, one.beams, one.mount, one.max_range, one.reach, one.body_radius),
                          one.costs, one.waypoint,
                          one.car ? std::optional(CarModel(*one.car, shape_.resolution)) : std::nullopt});
        if (one.costs.inflation + one.costs.comfort > widest.inflation + widest.comfort) widest = one.costs;
    }
    const bool cars = std::any_of(kinds_.begin(), kinds_.end(), [](const Kind &kind) { return kind.car.has_value(); });
    for (int k = 0; k < pool_.size(); ++k) {
        auto scratch = std::make_unique<Scratch>(Scratch{
            ScanIntegrator(shape_, b_.num_columns),
            RoutePlanner(shape_.height, shape_.width, shape_.resolution, widest),
            cars ? std::make_unique<CarRoute>(shape_) : nullptr,
            Path(),
        });
        scratch->route.reserve(kRouteCorners);
        stock_.add(std::move(scratch));
    }
}

void Replanner::restart(const std::uint8_t *mask, const double *pose) {
    for (int i = 0; i < num_robots_; ++i) {
        if (!mask[i]) continue;
        WindowOrigin at;
        clear_window(cells(i), shape_, at, {pose[3 * i], pose[3 * i + 1]});
        store_origin(i, at);
        b_.parity[i] = 0;
    }
}

void Replanner::observe(const std::uint8_t *mask, const double *pose, const float *ranges) {
    pool_.run(num_robots_, [&](int first, int last) {
        auto scratch = stock_.borrow();
        for (int i = first; i < last; ++i) {
            if (!mask[i]) continue;
            const Pose at = pose_at(pose, i);
            WindowOrigin window = origin(i);
            follow_robot(cells(i), shape_, window, {at.x, at.y});
            store_origin(i, window);
            scratch->integrator.integrate(kind_of(i).scanner, cells(i), window, at,
                                          ranges + static_cast<std::ptrdiff_t>(i) * b_.num_columns, b_.parity[i]);
            b_.parity[i] ^= 1U;
        }
    });
}

void Replanner::plan(const std::uint8_t *mask, const double *pose, const double *goal, const RouteCorners *routes) {
    pool_.run(num_robots_, [&](int first, int last) {
        auto scratch = stock_.borrow();
        for (int i = first; i < last; ++i) {
            if (mask[i]) plan_one(i, *scratch, pose_at(pose, i), point_at(goal, i), routes);
        }
    });
}

void Replanner::plan_one(int i, Scratch &scratch, const Pose &pose, Vec2 goal, const RouteCorners *routes) {
    RoutePlanner &planner = scratch.planner;
    const WindowOrigin window = origin(i);
    const Kind &kind = kind_of(i);
    planner.use(kind.costs);
    const Cell start = cell_of({pose.x, pose.y}, shape_, window);
    const Route route =
        planner.plan(cells(i), kind.scanner.evidence.wall(), start, cell_of(goal, shape_, window), pose.theta);
    if (route.cells->size() < 2 && !route.reached) {
        b_.found[i] = 0;
        return;
    }
    // Where a car finds no curves, what would lead another robot has to do.
    const bool curves = kind.car && scratch.car->plan(*kind.car, planner, route, window, pose, goal);
    const Waypoint chosen =
        curves ? scratch.car->waypoint(kind.waypoint, cells(i), window, pose)
               : choose_waypoint(planner, kind.costs, kind.waypoint, route, cells(i), shape_, window, pose, goal);
    b_.waypoint[2 * i] = chosen.point.x;
    b_.waypoint[2 * i + 1] = chosen.point.y;
    b_.route[i] = chosen.route;
    b_.found[i] = route.through ? 3 : route.reached ? 1 : 2;
    if (routes == nullptr) return;
    double *out = routes->points + static_cast<std::ptrdiff_t>(i) * 2 * kRouteCorners;
    int count = 0;
    const auto add = [&](Vec2 p) {
        if (count == kRouteCorners) return;
        out[2 * count] = p.x;
        out[2 * count++ + 1] = p.y;
    };
    if (curves) {
        for (const Vec2 &p : scratch.car->path().points()) add(p);
        routes->count[i] = count;
        return;
    }
    add({pose.x, pose.y});
    const std::vector<Cell> &cells = *route.cells;
    walk_taut(planner, cells, [&](std::size_t, std::size_t b) {
        add(b + 1 == cells.size() && route.reached ? goal : centre_of(cells[b], shape_, window));
    });
    routes->count[i] = count;
}

void Replanner::ahead(const std::uint8_t *mask, const double *pose, const RouteCorners &routes, double *along,
                      double *out) {
    pool_.run(num_robots_, [&](int first, int last) {
        auto scratch = stock_.borrow();
        for (int i = first; i < last; ++i) {
            if (!mask[i]) continue;
            const Pose at = pose_at(pose, i);
            Path &route = scratch->route;
            route.assign(routes.of(i));
            along[i] = come_along(route, {at.x, at.y}, along[i], kRouteWindow, kind_of(i).car.has_value());
            path_ahead(route, along[i], out + static_cast<std::ptrdiff_t>(i) * 2 * kPathAhead.size());
        }
    });
}

void Replanner::see(const std::uint8_t *mask, const double *pose, const double *point, double distance, bool known,
                    std::uint8_t *out) {
    pool_.run(num_robots_, [&](int first, int last) {
        for (int i = first; i < last; ++i) {
            if (!mask[i]) continue;
            const Vec2 from{pose[3 * i], pose[3 * i + 1]};
            const Vec2 way = point_at(point, i) - from;
            const double length = norm(way);
            const Vec2 to = length > distance ? from + (distance / length) * way : from + way;
            out[i] = corridor_seen_free(cells(i), shape_, origin(i), from, to, kind_of(i).waypoint.corridor, known);
        }
    });
}

} // namespace adrl
