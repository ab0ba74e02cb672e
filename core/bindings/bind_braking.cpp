#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>

#include <vector>

#include "arrays.hpp"
#include "drive/braking.hpp"
#include "footprint.hpp"

using namespace adrl;

namespace {

using Triple = std::tuple<double, double, double>;
using Pair = std::tuple<double, double>;

std::unique_ptr<Braking> make_braking(double radius, const In<double, Rows2> &corners, Triple response, double dt_s,
                                      double min_turning_radius) {
    const auto [acceleration, yaw_acceleration, lag_s] = response;
    require_finite({acceleration, yaw_acceleration, lag_s, dt_s}, "response or dt_s");
    if (!(min_turning_radius >= 0.0)) throw nb::value_error("min_turning_radius_m is negative");
    if (!(acceleration > 0.0 && yaw_acceleration > 0.0 && lag_s >= 0.0 && dt_s > 0.0)) {
        throw nb::value_error("response: give positive accelerations, a lag of 0 or more and a positive period");
    }
    DriveLimits limits;
    limits.max_acceleration = acceleration;
    limits.max_yaw_acceleration = yaw_acceleration;
    limits.lag_s = lag_s;
    limits.min_turning_radius = min_turning_radius;
    return std::make_unique<Braking>(make_footprint(radius, corners), limits, dt_s);
}

std::vector<Order> orders_of(const In<double, Rows3> &rows) {
    require_all_finite(rows, "orders");
    std::vector<Order> orders;
    for (std::size_t i = 0; i < rows.shape(0); ++i) orders.push_back({{rows(i, 0), rows(i, 1)}, rows(i, 2)});
    return orders;
}

std::tuple<Triple, Pair> roll(const Braking &self, Triple pose, Pair twist, const In<double, Rows3> &orders) {
    const auto [x, y, yaw] = pose;
    const auto [v, w] = twist;
    require_finite({x, y, yaw, v, w}, "pose or twist");
    const DriveState end = self.roll({{x, y, yaw}, {v, w}}, orders_of(orders));
    return {{end.pose.x, end.pose.y, end.pose.theta}, {end.twist.v, end.twist.w}};
}

bool stays_clear(const Braking &self, Pair twist, const In<double, Rows3> &orders, const In<double, Rows3> &hits,
                 const In<double, nb::shape<-1, 6>> &moving) {
    const auto [v, w] = twist;
    require_finite({v, w}, "twist");
    require_all_finite(hits, "hits");
    require_all_finite(moving, "moving");
    std::vector<Hit> near;
    near.reserve(hits.shape(0));
    for (std::size_t i = 0; i < hits.shape(0); ++i) near.push_back({{hits(i, 0), hits(i, 1)}, hits(i, 2)});
    std::vector<MovingHit> movers;
    movers.reserve(moving.shape(0));
    for (std::size_t i = 0; i < moving.shape(0); ++i)
        movers.push_back({{{moving(i, 0), moving(i, 1)}, moving(i, 2)}, {moving(i, 3), moving(i, 4)}, moving(i, 5)});
    return self.stays_clear({v, w}, orders_of(orders), near, movers);
}

} // namespace

void bind_braking(nb::module_ &m) {
    nb::class_<Braking>(m, "Braking")
        .def(nb::new_(&make_braking), nb::arg("radius_m"), nb::arg("footprint").noconvert(), nb::arg("response"),
             nb::arg("dt_s"), nb::arg("min_turning_radius_m") = 0.0)
        .def("roll", &roll, nb::arg("pose"), nb::arg("twist"), nb::arg("orders").noconvert())
        .def("stays_clear", &stays_clear, nb::arg("twist"), nb::arg("orders").noconvert(), nb::arg("hits").noconvert(),
             nb::arg("moving").noconvert());
}
