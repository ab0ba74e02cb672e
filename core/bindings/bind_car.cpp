#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>

#include "arrays.hpp"
#include "car.hpp"

using namespace adrl;

namespace {

using Triple = std::tuple<double, double, double>;
using Pair = std::tuple<double, double>;

Pose pose_of(const Triple &pose) {
    const auto [x, y, yaw] = pose;
    require_finite({x, y, yaw}, "pose");
    return {x, y, yaw};
}

nb::ndarray<nb::numpy, double> reeds_shepp_pieces(Triple from, Triple to, double radius) {
    if (!(radius > 0.0)) throw nb::value_error("radius_m is not positive");
    const CarCurve curve = reeds_shepp(pose_of(from), pose_of(to), radius);
    double *out = nullptr;
    auto array = new_array<double>({static_cast<std::size_t>(curve.count), 2}, out);
    for (int k = 0; k < curve.count; ++k) {
        out[2 * k] = curve.pieces[k].length;
        out[2 * k + 1] = curve.pieces[k].turn;
    }
    return array;
}

// A car's planner and the size of its grids.
struct BoundCarPlanner {
    CarModel model;
    CarPlanner planner;
    std::size_t height, width;
};

std::unique_ptr<BoundCarPlanner> make_car_planner(const Robot &robot, double margin, int height, int width,
                                                  double resolution) {
    if (!(resolution > 0.0)) throw nb::value_error("resolution_m is not positive");
    if (height < 1 || width < 1) throw nb::value_error("height or width is not positive");
    return std::unique_ptr<BoundCarPlanner>(
        new BoundCarPlanner{CarModel(car_of(robot, margin), resolution), CarPlanner(height, width, resolution),
                            static_cast<std::size_t>(height), static_cast<std::size_t>(width)});
}

nb::ndarray<nb::numpy, double> plan_car(BoundCarPlanner &self, const In<float, nb::shape<-1, -1>> &clearance,
                                        Pair origin, Triple start, Pair goal) {
    if (clearance.shape(0) != self.height || clearance.shape(1) != self.width)
        throw nb::value_error("clearance: (height, width)");
    const auto [x, y] = origin;
    const auto [goal_x, goal_y] = goal;
    require_finite({x, y, goal_x, goal_y}, "origin or goal");
    const Pose from = pose_of(start);
    bool found = false;
    {
        const nb::gil_scoped_release release;
        found = self.planner.plan(self.model, {clearance.data(), {x, y}}, from, {goal_x, goal_y});
    }
    const std::vector<Pose> none;
    const std::vector<Pose> &poses = found ? self.planner.poses() : none;
    double *out = nullptr;
    auto array = new_array<double>({poses.size(), 3}, out);
    for (std::size_t k = 0; k < poses.size(); ++k) {
        out[3 * k] = poses[k].x;
        out[3 * k + 1] = poses[k].y;
        out[3 * k + 2] = poses[k].theta;
    }
    return array;
}

} // namespace

void bind_car(nb::module_ &m) {
    m.def("reeds_shepp", &reeds_shepp_pieces, nb::arg("start"), nb::arg("goal"), nb::arg("radius_m"));
    nb::class_<BoundCarPlanner>(m, "CarPlanner")
        .def(nb::new_(&make_car_planner), nb::arg("robot"), nb::arg("margin_m"), nb::arg("height"), nb::arg("width"),
             nb::arg("resolution_m"))
        .def("plan", &plan_car, nb::arg("clearance_m").noconvert(), nb::arg("origin_m"), nb::arg("start"),
             nb::arg("goal"))
        .def_prop_ro("expanded", [](const BoundCarPlanner &self) { return self.planner.expanded(); });
}
