#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <string>
#include <tuple>

#include "arrays.hpp"
#include "bound_control.hpp"
#include "buffers.hpp"
#include "car.hpp"
#include "kinds.hpp"
#include "planning/path_guide.hpp"
#include "planning/replanner.hpp"

using namespace adrl;

namespace {

using Flat8 = In<std::uint8_t, nb::shape<-1>>;
using LogOdds = In<std::int8_t, nb::shape<-1, -1>>;

// The planner with references to the caller's arrays.
struct BoundReplanner {
    Replanner native;
    nb::object keep_alive;

    std::size_t robots() const { return static_cast<std::size_t>(native.num_robots()); }
    void require_kinds_known() const { require_kinds(native.kinds(), robots(), native.num_kinds()); }
    void require_rows(std::size_t rows, const char *name) const {
        if (rows != robots()) throw nb::value_error((std::string(name) + ": give one row a robot").c_str());
    }
    // Kernels turn coordinates into cells: what is not finite, or off the lattice, would leave the arrays.
    template <class Array>
    void require_points(const Flat8 &mask, const Array &points, const char *name) const {
        require_rows(points.shape(0), name);
        for (std::size_t i = 0; i < robots(); ++i) {
            if (!mask.data()[i]) continue;
            for (std::size_t k = 0; k < points.shape(1); ++k) {
                if (!(std::abs(points(i, k)) < 1e9))
                    throw nb::value_error((std::string(name) + ": give finite metres, below 1e9").c_str());
            }
        }
    }
};

void check(const RouteCosts &costs, double resolution) {
    for (const double share : {costs.k_obstacle, costs.k_goal, costs.k_turn}) {
        if (!(share >= 0.0 && share <= 1.0)) throw nb::value_error("k_obstacle, k_goal or k_turn is not in [0, 1]");
    }
    if (!(costs.near_goal > 0.0)) throw nb::value_error("near_goal_m is not positive");
    if (!(costs.weight >= 0.0 && costs.weight <= RoutePlanner::kMaxWeight && costs.turn >= 0.0 &&
          costs.turn <= RoutePlanner::kMaxTurn))
        throw nb::value_error("weight or turn_m is negative, or more than a route's cost can hold");
    if (!(costs.inflation >= 0.0 && costs.comfort >= 0.0))
        throw nb::value_error("inflation_m or comfort_m is negative or not a number");
    if (!((costs.inflation + costs.comfort) / resolution <= RoutePlanner::kMaxReach)) {
        throw nb::value_error(("inflation_m + comfort_m is more than " + std::to_string(RoutePlanner::kMaxReach) +
                               " cells; give less, or a greater resolution_m")
                                  .c_str());
    }
}

void check(const ReplannerSetup &s) {
    const auto positive = [](double x) { return std::isfinite(x) && x > 0.0; };
    if (s.shape.height < 8 || s.shape.width < 8 || s.shape.height > 4096 || s.shape.width > 4096)
        throw nb::value_error("a window has 8 to 4096 cells a side");
    if (!positive(s.shape.resolution) || !positive(s.max_range) || !positive(s.reach))
        throw nb::value_error("resolution_m, max_range_m or reach_m is not positive");
    check(s.costs, s.shape.resolution);
    const Evidence &e = s.evidence;
    if (e.low > 0 || e.low < -63 || e.high < 1 || e.high > 63 || e.hit <= -e.low || e.hit > 126 || e.miss < 0)
        throw nb::value_error("evidence: give -63 <= low <= 0 < high <= 63, -low < hit <= 126 and miss >= 0");
}

// Side by side are windows of one shape, and planners whose routes cost alike but for the clearances.
void require_alike(const ReplannerSetup &one, const ReplannerSetup &other) {
    const WindowShape &a = one.shape, &b = other.shape;
    RouteCosts costs = one.costs;
    costs.inflation = other.costs.inflation;
    costs.comfort = other.costs.comfort;
    if (a.height != b.height || a.width != b.width || a.resolution != b.resolution || !(costs == other.costs))
        throw nb::value_error("setups differ in more than the robot");
}

std::unique_ptr<BoundReplanner> make_replanner(int num_robots, int num_threads,
                                               const std::vector<ReplannerSetup> &setups, nb::dict buffers) {
    if (num_robots < 0) throw nb::value_error("num_robots is negative");
    if (setups.empty()) throw nb::value_error("setups: give one or more");
    int most_beams = 0;
    for (const ReplannerSetup &setup : setups) {
        check(setup);
        require_alike(setup, setups.front());
        most_beams = std::max(most_beams, setup.beams.count());
    }
    const WindowShape &shape = setups.front().shape;
    const auto n = static_cast<std::size_t>(num_robots);
    const auto height = static_cast<std::size_t>(shape.height);
    const auto width = static_cast<std::size_t>(shape.width);
    const ReplannerBuffers b{buffer<std::int64_t>(buffers, "kind", {n}),
                             most_beams,
                             buffer<std::int8_t>(buffers, "log_odds", {n, height, width}),
                             buffer<std::int64_t>(buffers, "origin", {n, 2}),
                             buffer<std::uint8_t>(buffers, "parity", {n}),
                             buffer<double>(buffers, "waypoint", {n, 2}),
                             buffer<double>(buffers, "route", {n}),
                             buffer<std::uint8_t>(buffers, "found", {n})};
    return std::unique_ptr<BoundReplanner>(new BoundReplanner{Replanner(num_robots, num_threads, setups, b),
                                                              nb::steal<nb::object>(PyDict_Copy(buffers.ptr()))});
}

void restart(BoundReplanner &self, const Flat8 &mask, const In<double, Rows3> &pose) {
    self.require_rows(mask.shape(0), "mask");
    self.require_points(mask, pose, "pose");
    const nb::gil_scoped_release release;
    self.native.restart(mask.data(), pose.data());
}

void observe(BoundReplanner &self, const Flat8 &mask, const In<double, Rows3> &pose,
             const In<float, nb::shape<-1, -1>> &ranges) {
    self.require_rows(mask.shape(0), "mask");
    self.require_points(mask, pose, "pose");
    self.require_rows(ranges.shape(0), "ranges");
    if (ranges.shape(1) != static_cast<std::size_t>(self.native.num_columns()))
        throw nb::value_error("ranges: give as many columns as the most beams of a robot");
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.native.observe(mask.data(), pose.data(), ranges.data());
}

using Corners = Out<double, nb::shape<-1, kRouteCorners, 2>>;
using Counts = Out<std::int32_t, nb::shape<-1>>;

RouteCorners corners_of(const BoundReplanner &self, Corners &corners, Counts &counts) {
    self.require_rows(corners.shape(0), "corners");
    self.require_rows(counts.shape(0), "counts");
    return {corners.data(), counts.data()};
}

void plan(BoundReplanner &self, const Flat8 &mask, const In<double, Rows3> &pose, const In<double, Rows2> &goal) {
    self.require_rows(mask.shape(0), "mask");
    self.require_points(mask, pose, "pose");
    self.require_points(mask, goal, "goal");
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.native.plan(mask.data(), pose.data(), goal.data());
}

void plan_routes(BoundReplanner &self, const Flat8 &mask, const In<double, Rows3> &pose, const In<double, Rows2> &goal,
                 Corners corners, Counts counts) {
    self.require_rows(mask.shape(0), "mask");
    self.require_points(mask, pose, "pose");
    self.require_points(mask, goal, "goal");
    const RouteCorners routes = corners_of(self, corners, counts);
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.native.plan(mask.data(), pose.data(), goal.data(), &routes);
}

void require_routes(const BoundReplanner &self, const Flat8 &mask, const RouteCorners &routes) {
    for (std::size_t i = 0; i < self.robots(); ++i) {
        if (mask.data()[i] && (routes.count[i] < 1 || routes.count[i] > kRouteCorners))
            throw nb::value_error(("counts: a route has 1 to " + std::to_string(kRouteCorners) + " corners").c_str());
    }
}

void drive_routes(BoundReplanner &self, BoundControl &control, const Flat8 &mask, const In<double, Rows3> &pose,
                  const In<double, Rows2> &twist, Corners corners, Counts counts, Out<double, nb::shape<-1>> along,
                  Out<double, Rows2> out) {
    self.require_rows(mask.shape(0), "mask");
    self.require_points(mask, pose, "pose");
    self.require_points(mask, twist, "twist");
    self.require_rows(along.shape(0), "along");
    self.require_rows(out.shape(0), "out");
    self.require_rows(static_cast<std::size_t>(control.native.num_robots()), "control");
    if (control.num_threads < self.native.pool().size()) throw nb::value_error("control: of as many threads");
    if (control.in_known_worlds_alone)
        throw nb::value_error("control: orca is told velocities, and a robot's own map has none");
    const RouteCorners routes = corners_of(self, corners, counts);
    require_routes(self, mask, routes);
    self.require_kinds_known();
    control.require_kinds_known();
    const nb::gil_scoped_release release;
    control.native.on_maps(self.native, mask.data(), pose.data(), twist.data(), routes, along.data(), out.data());
}

void ahead(BoundReplanner &self, const Flat8 &mask, const In<double, Rows3> &pose, Corners corners, Counts counts,
           Out<double, nb::shape<-1>> along, Out<double, nb::shape<-1, kPathAhead.size(), 2>> out) {
    self.require_rows(mask.shape(0), "mask");
    self.require_points(mask, pose, "pose");
    self.require_rows(along.shape(0), "along");
    self.require_rows(out.shape(0), "out");
    const RouteCorners routes = corners_of(self, corners, counts);
    require_routes(self, mask, routes);
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.native.ahead(mask.data(), pose.data(), routes, along.data(), out.data());
}

void see(BoundReplanner &self, const Flat8 &mask, const In<double, Rows3> &pose, const In<double, Rows2> &point,
         double distance, bool known, Out<std::uint8_t, nb::shape<-1>> out) {
    self.require_rows(mask.shape(0), "mask");
    self.require_rows(out.shape(0), "out");
    self.require_points(mask, pose, "pose");
    self.require_points(mask, point, "point");
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.native.see(mask.data(), pose.data(), point.data(), distance, known, out.data());
}

nb::tuple plan_route(RoutePlanner &self, const LogOdds &log_odds, std::pair<int, int> start, std::pair<int, int> goal,
                     double heading) {
    if (static_cast<int>(log_odds.shape(0)) != self.height() || static_cast<int>(log_odds.shape(1)) != self.width())
        throw nb::value_error("log_odds: its shape is not the planner's");
    if (start.first < 0 || start.second < 0 || start.first >= self.height() || start.second >= self.width())
        throw nb::value_error("start lies outside of the window");
    require_finite({heading}, "heading_rad");
    Route route{nullptr, 0.0, false};
    {
        const nb::gil_scoped_release release;
        route = self.plan(log_odds.data(), Evidence().wall(), {start.first, start.second}, {goal.first, goal.second},
                          heading);
    }
    std::int32_t *out = nullptr;
    auto cells = new_array<std::int32_t>({route.cells->size(), 2}, out);
    for (const Cell &c : *route.cells) {
        *out++ = c.row;
        *out++ = c.column;
    }
    return nb::make_tuple(cells, route.cost, route.reached);
}

} // namespace

void bind_replanner(nb::module_ &m) {
    nb::class_<Evidence>(m, "Evidence")
        .def(nb::init<>())
        .def_rw("hit", &Evidence::hit)
        .def_rw("miss", &Evidence::miss)
        .def_rw("low", &Evidence::low)
        .def_rw("high", &Evidence::high);
    nb::class_<RouteCosts>(m, "RouteCosts")
        .def(nb::init<>())
        .def_rw("inflation_m", &RouteCosts::inflation)
        .def_rw("comfort_m", &RouteCosts::comfort)
        .def_rw("near_goal_m", &RouteCosts::near_goal)
        .def_rw("weight", &RouteCosts::weight)
        .def_rw("k_obstacle", &RouteCosts::k_obstacle)
        .def_rw("k_goal", &RouteCosts::k_goal)
        .def_rw("k_turn", &RouteCosts::k_turn)
        .def_rw("turn_m", &RouteCosts::turn)
        .def_rw("headings", &RouteCosts::headings);
    nb::class_<WaypointRules>(m, "WaypointRules")
        .def(nb::init<>())
        .def_rw("min_interval_m", &WaypointRules::min_interval)
        .def_rw("max_distance_m", &WaypointRules::max_distance)
        .def_rw("corridor_m", &WaypointRules::corridor)
        .def_rw("literal", &WaypointRules::literal);
    nb::class_<ReplannerSetup>(m, "ReplannerSetup")
        .def(
            "__init__",
            [](ReplannerSetup *self, int height, int width, double resolution, const Evidence &evidence,
               std::tuple<int, double, double> beams, std::tuple<double, double, double> mount, double max_range,
               double reach, double body_radius, const RouteCosts &costs, const WaypointRules &waypoint,
               const Robot *car, double car_margin) {
                const auto [num_beams, angle_min, increment] = beams;
                if (num_beams < 1 || num_beams > 2048) throw nb::value_error("a LiDAR has 1 to 2048 beams");
                require_finite({angle_min, increment}, "beams");
                require_finite({std::get<0>(mount), std::get<1>(mount), std::get<2>(mount)}, "mount");
                new (self) ReplannerSetup{{height, width, resolution},
                                          Beams(num_beams, angle_min, increment),
                                          evidence,
                                          {std::get<0>(mount), std::get<1>(mount), std::get<2>(mount)},
                                          max_range,
                                          reach,
                                          body_radius,
                                          costs,
                                          waypoint,
                                          car ? std::optional(car_of(*car, car_margin)) : std::nullopt};
            },
            nb::kw_only(), nb::arg("height"), nb::arg("width"), nb::arg("resolution_m"), nb::arg("evidence"),
            nb::arg("beams"), nb::arg("mount"), nb::arg("max_range_m"), nb::arg("reach_m"), nb::arg("body_radius_m"),
            nb::arg("costs"), nb::arg("waypoint"), nb::arg("car").none() = nb::none(), nb::arg("car_margin_m") = 0.0);
    nb::class_<BoundReplanner>(m, "Replanner")
        .def(nb::new_(&make_replanner), nb::arg("num_robots"), nb::arg("num_threads"), nb::arg("setups"),
             nb::arg("buffers"))
        .def("restart", &restart, nb::arg("mask").noconvert(), nb::arg("pose").noconvert())
        .def("observe", &observe, nb::arg("mask").noconvert(), nb::arg("pose").noconvert(),
             nb::arg("ranges").noconvert())
        .def("plan", &plan, nb::arg("mask").noconvert(), nb::arg("pose").noconvert(), nb::arg("goal").noconvert())
        .def("plan_routes", &plan_routes, nb::arg("mask").noconvert(), nb::arg("pose").noconvert(),
             nb::arg("goal").noconvert(), nb::arg("corners").noconvert(), nb::arg("counts").noconvert())
        .def("drive", &drive_routes, nb::arg("control"), nb::arg("mask").noconvert(), nb::arg("pose").noconvert(),
             nb::arg("twist").noconvert(), nb::arg("corners").noconvert(), nb::arg("counts").noconvert(),
             nb::arg("along").noconvert(), nb::arg("out").noconvert())
        .def("ahead", &ahead, nb::arg("mask").noconvert(), nb::arg("pose").noconvert(), nb::arg("corners").noconvert(),
             nb::arg("counts").noconvert(), nb::arg("along").noconvert(), nb::arg("out").noconvert())
        .def("see", &see, nb::arg("mask").noconvert(), nb::arg("pose").noconvert(), nb::arg("point").noconvert(),
             nb::arg("distance_m"), nb::arg("known"), nb::arg("out").noconvert());
    m.attr("ROUTE_CORNERS") = kRouteCorners;
    m.attr("PATH_POINTS_M") = nb::cast(std::vector<double>(kPathAhead.begin(), kPathAhead.end()));
    m.attr("MAX_CLEARANCE_CELLS") = RoutePlanner::kMaxReach;
    m.attr("MAX_DENSITY_WEIGHT") = RoutePlanner::kMaxWeight;
    m.attr("MAX_TURN_COST_M") = RoutePlanner::kMaxTurn;
    nb::class_<RoutePlanner>(m, "RoutePlanner")
        .def(nb::new_([](int height, int width, double resolution, const RouteCosts &costs) {
                 if (height < 1 || width < 1 || height > 4096 || width > 4096 || !(resolution > 0.0))
                     throw nb::value_error("a window has 1 to 4096 cells a side, of positive size");
                 check(costs, resolution);
                 return std::make_unique<RoutePlanner>(height, width, resolution, costs);
             }),
             nb::arg("height"), nb::arg("width"), nb::arg("resolution_m"), nb::arg("costs"))
        .def("plan", &plan_route, nb::arg("log_odds").noconvert(), nb::arg("start"), nb::arg("goal"),
             nb::arg("heading_rad") = 0.0);
}
