#include <algorithm>
#include <cmath>
#include <vector>

#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "bound_control.hpp"
#include "buffers.hpp"
#include "sim/batch_sim.hpp"

using namespace adrl;

namespace {

using Flat8 = In<std::uint8_t, nb::shape<-1>>;

bool positive(double value) { return value > 0.0 && std::isfinite(value); }

void check(const DwaConfig &dwa) {
    if (!(positive(dwa.lookahead) && positive(dwa.horizon_s) && positive(dwa.comfort_m)))
        throw nb::value_error("dwa: lookahead_m, horizon_s or comfort_m is not positive");
    if (!(dwa.margin_m >= 0.0)) throw nb::value_error("dwa: margin_m is negative");
}

void check(const PursuitConfig &pursuit) {
    if (!(positive(pursuit.min_lookahead_dist) && positive(pursuit.cost_scaling_dist)))
        throw nb::value_error("pursuit: min_lookahead_dist or cost_scaling_dist is not positive");
    if (!(pursuit.max_lookahead_dist >= pursuit.min_lookahead_dist))
        throw nb::value_error("pursuit: max_lookahead_dist is less than min_lookahead_dist");
    if (!(pursuit.margin_m >= 0.0)) throw nb::value_error("pursuit: margin_m is negative");
}

void check(const MppiConfig &mppi) {
    if (mppi.batch_size < 1 || mppi.batch_size > kMaxMppiBatch || mppi.time_steps < 1 ||
        mppi.time_steps > kMaxMppiSteps)
        throw nb::value_error("mppi: batch_size or time_steps is not positive, or more than MPPI_MOST");
    if (!(positive(mppi.temperature) && positive(mppi.model_dt) && positive(mppi.inflation_m) &&
          positive(mppi.collision_margin_m)))
        throw nb::value_error("mppi: temperature, model_dt, inflation_m or collision_margin_m is not positive");
    if (!(std::abs(mppi.noise_correlation) <= 1.0)) throw nb::value_error("mppi: noise_correlation is not in [-1, 1]");
}

void check(const OrcaConfig &orca) {
    if (!(positive(orca.lookahead) && positive(orca.horizon_s) && positive(orca.wall_horizon_s) &&
          positive(orca.turn_s)))
        throw nb::value_error("orca: lookahead_m, horizon_s, wall_horizon_s or turn_s is not positive");
    if (!(orca.space_m >= 0.0 && orca.share >= 0.0 && orca.share <= 1.0))
        throw nb::value_error("orca: space_m is negative or share not in [0, 1]");
}

void check(const ControllerConfig &controller) {
    std::visit([](const auto &config) { check(config); }, controller);
}

// A robot; its greatest acceleration and yaw acceleration, and its lag; what drives it.
using ControlKind = std::tuple<Robot, std::tuple<double, double, double>, ControllerConfig>;

ControlSetup make_setup(const ControlKind &kind, bool foresee) {
    const auto &[robot, response, controller] = kind;
    const auto [acceleration, yaw_acceleration, lag_s] = response;
    if (!(acceleration > 0.0 && yaw_acceleration > 0.0 && lag_s >= 0.0))
        throw nb::value_error("response: give positive accelerations and a lag of 0 or more");
    check(controller);
    ControlSetup setup{robot.footprint, robot.limits, robot.dt_s, foresee, controller};
    setup.limits.max_acceleration = acceleration;
    setup.limits.max_yaw_acceleration = yaw_acceleration;
    setup.limits.lag_s = lag_s;
    return setup;
}

std::unique_ptr<BoundControl> make_control(int num_robots, int num_threads, const std::vector<ControlKind> &kinds,
                                           bool foresee, nb::dict buffers) {
    if (num_robots < 0 || num_threads < 1) throw nb::value_error("num_robots is negative or num_threads not positive");
    if (kinds.empty()) throw nb::value_error("kinds: give one or more");
    std::vector<ControlSetup> setups;
    std::size_t size = 0;
    bool told = false;
    for (const ControlKind &kind : kinds) {
        setups.push_back(make_setup(kind, foresee));
        size = std::max(size, static_cast<std::size_t>(control_memory(std::get<2>(kind))));
        told = told || std::holds_alternative<OrcaConfig>(std::get<2>(kind));
    }
    const auto n = static_cast<std::size_t>(num_robots);
    const std::int64_t *kind = buffer<std::int64_t>(buffers, "kind", {n});
    double *memory = buffer<double>(buffers, "memory", {n, size});
    return std::unique_ptr<BoundControl>(
        new BoundControl{LocalControl(num_robots, num_threads, std::move(setups), kind, memory), num_threads, told,
                         nb::steal<nb::object>(PyDict_Copy(buffers.ptr()))});
}

} // namespace

void bind_control(nb::module_ &m) {
    nb::class_<DwaConfig>(m, "DwaConfig")
        .def(nb::init<>())
        .def_rw("lookahead_m", &DwaConfig::lookahead)
        .def_rw("horizon_s", &DwaConfig::horizon_s)
        .def_rw("margin_m", &DwaConfig::margin_m)
        .def_rw("comfort_m", &DwaConfig::comfort_m)
        .def_rw("comfort_weight", &DwaConfig::comfort_weight)
        .def_rw("heading_weight", &DwaConfig::heading_weight)
        .def_rw("hit_weight", &DwaConfig::hit_weight);
    nb::class_<PursuitConfig>(m, "PursuitConfig")
        .def(nb::init<>())
        .def_rw("lookahead_time", &PursuitConfig::lookahead_time)
        .def_rw("min_lookahead_dist", &PursuitConfig::min_lookahead_dist)
        .def_rw("max_lookahead_dist", &PursuitConfig::max_lookahead_dist)
        .def_rw("rotate_to_heading_min_angle", &PursuitConfig::rotate_to_heading_min_angle)
        .def_rw("regulated_linear_scaling_min_radius", &PursuitConfig::regulated_linear_scaling_min_radius)
        .def_rw("regulated_linear_scaling_min_speed", &PursuitConfig::regulated_linear_scaling_min_speed)
        .def_rw("cost_scaling_dist", &PursuitConfig::cost_scaling_dist)
        .def_rw("cost_scaling_gain", &PursuitConfig::cost_scaling_gain)
        .def_rw("max_allowed_time_to_collision", &PursuitConfig::max_allowed_time_to_collision)
        .def_rw("margin_m", &PursuitConfig::margin_m);
    nb::class_<MppiConfig>(m, "MppiConfig")
        .def(nb::init<>())
        .def_rw("batch_size", &MppiConfig::batch_size)
        .def_rw("time_steps", &MppiConfig::time_steps)
        .def_rw("model_dt", &MppiConfig::model_dt)
        .def_rw("temperature", &MppiConfig::temperature)
        .def_rw("gamma", &MppiConfig::gamma)
        .def_rw("vx_std", &MppiConfig::vx_std)
        .def_rw("wz_std", &MppiConfig::wz_std)
        .def_rw("noise_correlation", &MppiConfig::noise_correlation)
        .def_rw("collision_cost", &MppiConfig::collision_cost)
        .def_rw("collision_margin_m", &MppiConfig::collision_margin_m)
        .def_rw("inflation_m", &MppiConfig::inflation_m)
        .def_rw("repulsion_weight", &MppiConfig::repulsion_weight)
        .def_rw("path_align_weight", &MppiConfig::path_align_weight)
        .def_rw("path_follow_weight", &MppiConfig::path_follow_weight)
        .def_rw("path_follow_offset_m", &MppiConfig::path_follow_offset_m)
        .def_rw("path_angle_weight", &MppiConfig::path_angle_weight)
        .def_rw("max_angle_to_furthest", &MppiConfig::max_angle_to_furthest)
        .def_rw("goal_weight", &MppiConfig::goal_weight)
        .def_rw("goal_threshold_m", &MppiConfig::goal_threshold_m)
        .def_rw("prefer_forward_weight", &MppiConfig::prefer_forward_weight);
    nb::class_<OrcaConfig>(m, "OrcaConfig")
        .def(nb::init<>())
        .def_rw("lookahead_m", &OrcaConfig::lookahead)
        .def_rw("share", &OrcaConfig::share)
        .def_rw("horizon_s", &OrcaConfig::horizon_s)
        .def_rw("wall_horizon_s", &OrcaConfig::wall_horizon_s)
        .def_rw("space_m", &OrcaConfig::space_m)
        .def_rw("turn_s", &OrcaConfig::turn_s);
    m.attr("MPPI_MOST") = nb::make_tuple(kMaxMppiBatch, kMaxMppiSteps);
    m.def(
        "mppi_noise",
        [](const MppiConfig &config) {
            check(config);
            const std::vector<float> noise = mppi_noise(config);
            float *out = nullptr;
            auto array = new_array<float>(
                {static_cast<std::size_t>(config.time_steps), 2, static_cast<std::size_t>(config.batch_size)}, out);
            std::copy(noise.begin(), noise.end(), out);
            return array;
        },
        nb::arg("config"));
    m.def("control_memory", &control_memory, nb::arg("controller"));
    nb::class_<BoundControl>(m, "LocalControl")
        .def_prop_rw(
            "recovers", [](const BoundControl &b) { return b.native.recovers; },
            [](BoundControl &b, bool recovers) { b.native.recovers = recovers; })
        .def(nb::new_(&make_control), nb::arg("num_robots"), nb::arg("num_threads"), nb::arg("kinds"),
             nb::arg("foresee"), nb::arg("buffers"));
}
