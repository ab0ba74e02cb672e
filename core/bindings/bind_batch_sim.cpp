#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "bound_control.hpp"
#include "buffers.hpp"
#include "footprint.hpp"
#include "kinds.hpp"
#include "sim/batch_sim.hpp"

using namespace adrl;

namespace {

using Flat8 = In<std::uint8_t, nb::shape<-1>>;

std::shared_ptr<Task> make_task(std::shared_ptr<World> world, std::tuple<double, double, double> start,
                                std::tuple<double, double> goal, double tolerance, const In<double, Rows2> &path,
                                std::shared_ptr<Crowd> crowd) {
    if (path.shape(0) < 1) throw nb::value_error("a path has at least one point");
    require_finite({std::get<0>(start), std::get<1>(start), std::get<2>(start)}, "start");
    require_finite({std::get<0>(goal), std::get<1>(goal)}, "goal");
    require_all_finite(path, "path");
    if (crowd) {
        if (world->discs().size() + crowd->walkers.size() > kMaxDiscs) {
            throw nb::value_error("crowd: with the moving discs of the world at most 64");
        }
        world->lay_walls();
    }
    return std::make_shared<Task>(Task{std::move(world),
                                       {std::get<0>(start), std::get<1>(start), std::get<2>(start)},
                                       {std::get<0>(goal), std::get<1>(goal)},
                                       tolerance,
                                       Path(view(path)),
                                       std::move(crowd)});
}

Robot make_robot(double radius, const In<double, Rows2> &corners, std::tuple<double, double, double> speed_limits,
                 int num_beams, double angle_min, double increment, std::tuple<double, double, double> mount,
                 double max_range, double dt_s, double min_turning_radius) {
    if (num_beams < 1 || num_beams > 2048) throw nb::value_error("a LiDAR has 1 to 2048 beams");
    require_finite({std::get<0>(speed_limits), std::get<1>(speed_limits), std::get<2>(speed_limits)}, "speed_limits");
    require_finite({angle_min, increment}, "angle_min_rad or angle_increment_rad");
    require_finite({std::get<0>(mount), std::get<1>(mount), std::get<2>(mount)}, "mount");
    if (!(max_range > 0.0 && dt_s > 0.0)) throw nb::value_error("max_range_m or dt_s is not positive");
    if (!(min_turning_radius >= 0.0)) throw nb::value_error("min_turning_radius_m is negative");
    DriveLimits limits;
    limits.max_speed = std::get<0>(speed_limits);
    limits.min_speed = std::get<1>(speed_limits);
    limits.max_yaw_rate = std::get<2>(speed_limits);
    limits.min_turning_radius = min_turning_radius;
    return {make_footprint(radius, corners),
            limits,
            Beams(num_beams, angle_min, increment),
            {std::get<0>(mount), std::get<1>(mount), std::get<2>(mount)},
            max_range,
            dt_s};
}

// A path in a world, and where on it one robot outside of a simulator is.
class BoundGuide {
  public:
    BoundGuide(std::shared_ptr<World> world, const Robot &robot, const SimConfig &config, Path path)
        : world_(std::move(world)), rules_(guide_rules(robot, config)), path_(std::move(path)) {}
    std::tuple<std::tuple<double, double>, double> follow(double x, double y) {
        require_finite({x, y}, "position");
        const Guided guided = follow_path(*world_, path_, rules_, {x, y}, along_);
        along_ = guided.along;
        return {{guided.waypoint.x, guided.waypoint.y}, guided.left};
    }
    nb::object ahead() const {
        double *out = nullptr;
        auto points = new_array<double>({kPathAhead.size(), 2}, out);
        path_ahead(path_, along_, out);
        return nb::cast(points);
    }

  private:
    std::shared_ptr<World> world_;
    GuideRules rules_;
    Path path_;
    double along_ = 0.0;
};

std::unique_ptr<BoundGuide> make_guide(std::shared_ptr<World> world, const Robot &robot, const SimConfig &config,
                                       const In<double, Rows2> &path) {
    if (path.shape(0) < 1) throw nb::value_error("a path has at least one point");
    require_all_finite(path, "path");
    return std::make_unique<BoundGuide>(std::move(world), robot, config, Path(view(path)));
}

// The simulator with references to the caller's arrays.
struct BoundSim {
    BatchSim sim;
    SimBuffers buffers;
    nb::object keep_alive;

    // Whoever writes the kinds may write anything.
    void require_kinds_known() const {
        require_kinds(buffers.kind, static_cast<std::size_t>(sim.num_envs()), sim.num_kinds());
    }
};

std::unique_ptr<BoundSim> make_sim(int num_envs, int num_threads,
                                   const std::vector<std::pair<Robot, SimConfig>> &robots, nb::dict buffers) {
    if (num_envs < 0) throw nb::value_error("num_envs is negative");
    if (robots.empty()) throw nb::value_error("kinds: give one or more");
    std::vector<SimKind> kinds;
    int most_beams = 0;
    for (const auto &[robot, config] : robots) {
        kinds.emplace_back(robot, config);
        most_beams = std::max(most_beams, robot.beams.count());
    }
    const auto n = static_cast<std::size_t>(num_envs);
    const auto beams = static_cast<std::size_t>(most_beams);
    const auto f64 = [&](const char *name, std::initializer_list<std::size_t> shape) {
        return buffer<double>(buffers, name, shape);
    };
    const auto u8 = [&](const char *name) { return buffer<std::uint8_t>(buffers, name, {n}); };
    const SimBuffers b{buffer<std::int64_t>(buffers, "kind", {n}),
                       most_beams,
                       f64("command", {n, 2}),
                       u8("active"),
                       buffer<std::uint64_t>(buffers, "seed", {n}),
                       f64("params", {n, kNumParams}),
                       buffer<float>(buffers, "ranges", {n, beams}),
                       f64("pose", {n, 3}),
                       f64("odometry", {n, 3}),
                       f64("twist", {n, 2}),
                       f64("clearance", {n}),
                       f64("least_clearance", {n}),
                       f64("waypoint", {n, 2}),
                       buffers.contains("path_ahead") ? f64("path_ahead", {n, kPathAhead.size(), 2}) : nullptr,
                       f64("route_left", {n}),
                       f64("time", {n}),
                       f64("travelled", {n}),
                       u8("reached"),
                       u8("collided"),
                       u8("at_fault"),
                       f64("memory", {n, kMemory}),
                       f64("people", {n, kMaxPeople, kPersonNumbers})};
    // A copy of the dictionary: taking an array out of the caller's must not free it under the simulator.
    return std::unique_ptr<BoundSim>(new BoundSim{BatchSim(num_envs, num_threads, std::move(kinds), b), b,
                                                  nb::steal<nb::object>(PyDict_Copy(buffers.ptr()))});
}

void set_task(BoundSim &self, int i, std::shared_ptr<Task> task) {
    if (i < 0 || i >= self.sim.num_envs()) throw nb::index_error("no such robot");
    self.sim.set_task(i, std::move(task));
}

void set_path(BoundSim &self, int i, std::shared_ptr<Task> task) {
    if (i < 0 || i >= self.sim.num_envs()) throw nb::index_error("no such robot");
    self.require_kinds_known();
    self.sim.set_path(i, std::move(task));
}

void reset(BoundSim &self, const Flat8 &mask) {
    if (mask.shape(0) != static_cast<std::size_t>(self.sim.num_envs())) throw nb::value_error("mask");
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.sim.reset(mask.data());
}

void step(BoundSim &self) {
    self.require_kinds_known();
    for (int i = 0; i < self.sim.num_envs(); ++i) {
        if (self.buffers.active[i])
            require_finite({self.buffers.command[2 * i], self.buffers.command[2 * i + 1]}, "command");
    }
    const nb::gil_scoped_release release;
    self.sim.step();
}

void follow(BoundSim &self, const In<double, nb::shape<-1, 3>> &before) {
    if (before.shape(0) != static_cast<std::size_t>(self.sim.num_envs())) throw nb::value_error("before");
    self.require_kinds_known();
    const nb::gil_scoped_release release;
    self.sim.follow(before.data());
}

void plan(BoundSim &self, const Flat8 &mask, BoundControl &control, Out<double, Rows2> out) {
    if (mask.shape(0) != static_cast<std::size_t>(self.sim.num_envs())) throw nb::value_error("mask");
    if (out.shape(0) != static_cast<std::size_t>(self.sim.num_envs())) throw nb::value_error("out");
    if (control.native.num_robots() != self.sim.num_envs()) throw nb::value_error("control: of as many robots");
    if (control.num_threads < self.sim.num_threads()) throw nb::value_error("control: of as many threads");
    self.require_kinds_known();
    control.require_kinds_known();
    const nb::gil_scoped_release release;
    self.sim.plan(mask.data(), control.native, out.data());
}

} // namespace

void bind_batch_sim(nb::module_ &m) {
    nb::class_<Task>(m, "Task").def(nb::new_(&make_task), nb::arg("world"), nb::arg("start"), nb::arg("goal"),
                                    nb::arg("goal_tolerance_m"), nb::arg("path").noconvert(),
                                    nb::arg("crowd").none() = nb::none());
    nb::class_<Robot>(m, "Robot")
        .def(nb::new_(&make_robot), nb::arg("radius_m"), nb::arg("footprint").noconvert(), nb::arg("speed_limits"),
             nb::arg("num_beams"), nb::arg("angle_min_rad"), nb::arg("angle_increment_rad"), nb::arg("mount"),
             nb::arg("max_range_m"), nb::arg("dt_s"), nb::arg("min_turning_radius_m") = 0.0);
    nb::class_<SimConfig>(m, "SimConfig")
        .def(nb::init<>())
        .def_rw("clearance_limit_m", &SimConfig::clearance_limit)
        .def_rw("lookahead_m", &SimConfig::lookahead)
        .def_rw("search_m", &SimConfig::search)
        .def_rw("waypoint_is_given", &SimConfig::waypoint_is_given);
    nb::class_<BoundGuide>(m, "PathGuide")
        .def(nb::new_(&make_guide), nb::arg("world"), nb::arg("robot"), nb::arg("config"), nb::arg("path").noconvert())
        .def("follow", &BoundGuide::follow, nb::arg("x_m"), nb::arg("y_m"))
        .def("ahead", &BoundGuide::ahead);
    nb::class_<BoundSim>(m, "BatchSim")
        .def(nb::new_(&make_sim), nb::arg("num_envs"), nb::arg("num_threads"), nb::arg("kinds"), nb::arg("buffers"))
        .def_prop_ro("num_threads", [](const BoundSim &self) { return self.sim.num_threads(); })
        .def("set_task", &set_task, nb::arg("index"), nb::arg("task"))
        .def("set_path", &set_path, nb::arg("index"), nb::arg("task"))
        .def("reset", &reset, nb::arg("mask").noconvert())
        .def("step", &step)
        .def("follow", &follow, nb::arg("before").noconvert())
        .def("plan", &plan, nb::arg("mask"), nb::arg("control"), nb::arg("out").noconvert());
    m.attr("NUM_PARAMS") = static_cast<int>(kNumParams);
    m.attr("MEMORY_SIZE") = kMemory;
    m.attr("MAX_PEOPLE") = kMaxPeople;
    m.attr("PERSON_NUMBERS") = kPersonNumbers;
    m.attr("MAX_LATENCY_PERIODS") = kHistory - 1;
    m.attr("MAX_CORNERS") = kMaxCorners;
}
