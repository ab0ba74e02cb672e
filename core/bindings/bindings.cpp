// Python's view of the core. Checks shapes and dtypes, releases the GIL and calls; no logic.
#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <tuple>

#include "arrays.hpp"
#include "drive/kinematics.hpp"
#include "footprint.hpp"
#include "planning/astar.hpp"
#include "planning/grid.hpp"
#include "world/distance_field.hpp"
#include "world/moving.hpp"
#include "world/raycast.hpp"
#include "world/world.hpp"

using namespace adrl;

namespace {

using Bitmap8 = In<std::uint8_t, nb::shape<-1, -1>>;

Pose pose_at(const In<double, Rows3> &poses, std::size_t i) { return {poses(i, 0), poses(i, 1), poses(i, 2)}; }

Returned<float> raycast_many(const World &world, const In<double, Rows3> &poses,
                             const In<double, nb::shape<-1>> &angles, double max_range, double time_s) {
    require_all_finite(poses, "poses");
    require_all_finite(angles, "angles_rad");
    const Beams beams(std::vector<double>(angles.data(), angles.data() + angles.size()));
    float *out = nullptr;
    auto result = new_array<float>({poses.shape(0), angles.size()}, out);
    const nb::gil_scoped_release release;
    const DiscPlaces discs = Moving(world).at(time_s);
    std::vector<double> ranges(beams.padded());
    for (std::size_t i = 0; i < poses.shape(0); ++i) {
        raycast(world, discs, pose_at(poses, i), beams, max_range, ranges.data());
        std::copy(ranges.begin(), ranges.begin() + beams.count(), out + i * angles.size());
    }
    return result;
}

Returned<double> clearance_many(const World &world, const In<double, Rows3> &poses, double radius,
                                const In<double, Rows2> &corners, double limit, double time_s) {
    require_all_finite(poses, "poses");
    const Footprint footprint = make_footprint(radius, corners);
    double *out = nullptr;
    auto result = new_array<double>({poses.shape(0)}, out);
    const nb::gil_scoped_release release;
    const DiscPlaces discs = Moving(world).at(time_s);
    for (std::size_t i = 0; i < poses.shape(0); ++i) {
        out[i] = clearance(world, discs, footprint, pose_at(poses, i), limit);
    }
    return result;
}

Returned<float> clearance_field_of(const World &world, double origin_x, double origin_y, int width, int height,
                                   double resolution, double limit) {
    float *out = nullptr;
    auto result = new_array<float>({static_cast<std::size_t>(height), static_cast<std::size_t>(width)}, out);
    const nb::gil_scoped_release release;
    clearance_field(world, {origin_x, origin_y, width, height, resolution}, limit, out);
    return result;
}

Returned<float> distance_field_of(const Bitmap8 &solid, double resolution) {
    float *out = nullptr;
    auto result = new_array<float>({solid.shape(0), solid.shape(1)}, out);
    const nb::gil_scoped_release release;
    distance_field(solid.data(), static_cast<int>(solid.shape(0)), static_cast<int>(solid.shape(1)), out);
    for (std::size_t i = 0; i < solid.size(); ++i) out[i] *= static_cast<float>(resolution);
    return result;
}

nb::tuple astar_on(const Bitmap8 &blocked, std::pair<int, int> start, std::pair<int, int> goal) {
    GridPath path;
    {
        const nb::gil_scoped_release release;
        path = astar(blocked.data(), static_cast<int>(blocked.shape(0)), static_cast<int>(blocked.shape(1)),
                     {start.first, start.second}, {goal.first, goal.second});
    }
    std::int32_t *out = nullptr;
    auto cells = new_array<std::int32_t>({path.cells.size(), 2}, out);
    for (const Cell &c : path.cells) {
        *out++ = c.row;
        *out++ = c.column;
    }
    return nb::make_tuple(cells, path.length);
}

Returned<double> shorten_path_on(const Bitmap8 &blocked, const In<std::int32_t, Rows2> &cells) {
    std::vector<Cell> path;
    for (std::size_t i = 0; i < cells.shape(0); ++i) path.push_back({cells(i, 0), cells(i, 1)});
    std::vector<GridPoint> corners;
    {
        const nb::gil_scoped_release release;
        corners =
            shorten_path(blocked.data(), static_cast<int>(blocked.shape(0)), static_cast<int>(blocked.shape(1)), path);
    }
    double *out = nullptr;
    auto result = new_array<double>({corners.size(), 2}, out);
    for (const GridPoint &p : corners) {
        *out++ = p.row;
        *out++ = p.column;
    }
    return result;
}

Returned<double> integrate_many(const In<double, Rows3> &poses, const In<double, Rows2> &twists, double dt_s) {
    if (poses.shape(0) != twists.shape(0)) throw nb::value_error("poses and twists differ in length");
    double *out = nullptr;
    auto result = new_array<double>({poses.shape(0), 3}, out);
    for (std::size_t i = 0; i < poses.shape(0); ++i) {
        const Pose pose = integrate(pose_at(poses, i), {twists(i, 0), twists(i, 1)}, dt_s);
        *out++ = pose.x;
        *out++ = pose.y;
        *out++ = pose.theta;
    }
    return result;
}

std::shared_ptr<World> make_world(const In<double, Rows3> &circles, const In<double, Rows2> &corners,
                                  const In<std::int32_t, nb::shape<-1>> &offsets, const In<double, Rows4> &segments,
                                  const In<double, Rows8> &discs, const Bitmap8 &solid, double resolution,
                                  std::tuple<double, double, double> origin) {
    require_all_finite(circles, "circles");
    require_all_finite(corners, "polygon_corners");
    require_all_finite(segments, "segments");
    for (std::size_t i = 0; i < discs.size(); ++i) { // the last of eight, stop_s, may be infinite
        require_finite({i % 8 == 7 ? std::min(discs.data()[i], 0.0) : discs.data()[i]}, "discs");
    }
    require_finite({std::get<0>(origin), std::get<1>(origin), std::get<2>(origin)}, "origin");
    if (!(resolution > 0.0)) throw nb::value_error("resolution_m is not positive");
    // Out of step with the corners, the offsets would lead the kernels out of their arrays.
    const auto *end = offsets.data() + offsets.size();
    bool fits = offsets.size() > 0 && *offsets.data() == 0 && end[-1] == static_cast<std::int64_t>(corners.shape(0));
    for (const auto *first = offsets.data(); fits && first + 1 < end; ++first) fits = first[0] + 3 <= first[1];
    if (!fits) throw nb::value_error("polygon_offsets: give 0, rising by 3 or more, up to the number of corners");
    return std::make_shared<World>(view(circles), view(corners), view(offsets), view(segments), view(discs),
                                   solid.data(), static_cast<int>(solid.shape(0)), static_cast<int>(solid.shape(1)),
                                   resolution, Pose{std::get<0>(origin), std::get<1>(origin), std::get<2>(origin)});
}

std::shared_ptr<Crowd> make_crowd(const In<double, nb::shape<-1, 6>> &walkers, const In<double, Rows2> &way_points,
                                  const In<std::int32_t, nb::shape<-1>> &offsets, bool legs) {
    require_all_finite(walkers, "walkers");
    require_all_finite(way_points, "way_points");
    const std::size_t n = walkers.shape(0);
    if (n > kMaxPeople) throw nb::value_error("walkers: at most 64");
    bool fits = offsets.size() == n + 1 && *offsets.data() == 0 &&
                offsets.data()[n] == static_cast<std::int64_t>(way_points.shape(0));
    auto made = std::make_shared<Crowd>();
    Crowd &crowd = *made;
    crowd.legs = legs;
    for (std::size_t i = 0; fits && i < n; ++i) {
        const auto row = [&](int j) { return walkers(i, j); };
        fits = offsets.data()[i] + (row(1) > 0.0 ? 2 : 1) <= offsets.data()[i + 1];
        crowd.walkers.push_back({row(0), row(1), row(2), row(3), static_cast<int>(row(4)), row(5) > 0.0,
                                 offsets.data()[i], offsets.data()[i + 1]});
    }
    if (!fits)
        throw nb::value_error("way_offsets: give 0, rising by 1 or more, for who walks 2, to the points' number");
    for (std::size_t i = 0; i < way_points.shape(0); ++i)
        crowd.way_points.push_back({way_points(i, 0), way_points(i, 1)});
    return made;
}

Returned<double> seen_of(const World &world, const std::shared_ptr<Crowd> &crowd,
                         const In<double, nb::shape<-1, kPersonNumbers>> &people, double time_s) {
    if (crowd && people.shape(0) < static_cast<std::size_t>(crowd->count()))
        throw nb::value_error("people: fewer rows than the crowd has people");
    const auto *walkers = reinterpret_cast<const Person *>(people.data());
    const DiscPlaces seen = Moving(world, crowd.get(), walkers, time_s).seen_at(time_s);
    double *out = nullptr;
    auto result = new_array<double>({static_cast<std::size_t>(seen.count), 3}, out);
    for (int i = 0; i < seen.count; ++i) {
        out[3 * i] = seen.x[i];
        out[3 * i + 1] = seen.y[i];
        out[3 * i + 2] = seen.radius[i];
    }
    return result;
}

} // namespace

void bind_batch_sim(nb::module_ &m);
void bind_braking(nb::module_ &m);
void bind_car(nb::module_ &m);
void bind_control(nb::module_ &m);
void bind_misfit(nb::module_ &m);
void bind_replanner(nb::module_ &m);
void bind_scans(nb::module_ &m);

NB_MODULE(_core, m) {
    nb::set_leak_warnings(false); // robots in module globals outlive the interpreter; nothing is lost
    m.doc() = "Kernels of ADRL: ray casting, kinematics, collision, planning and the batch simulator.";
    nb::class_<Crowd>(m, "Crowd")
        .def(nb::new_(&make_crowd), nb::arg("walkers").noconvert(), nb::arg("way_points").noconvert(),
             nb::arg("way_offsets").noconvert(), nb::arg("legs"));
    nb::class_<World>(m, "World")
        .def(nb::new_(&make_world), nb::arg("circles").noconvert(), nb::arg("polygon_corners").noconvert(),
             nb::arg("polygon_offsets").noconvert(), nb::arg("segments").noconvert(), nb::arg("discs").noconvert(),
             nb::arg("solid").noconvert(), nb::arg("resolution_m"), nb::arg("origin"));
    m.def("raycast", &raycast_many, nb::arg("world"), nb::arg("poses").noconvert(), nb::arg("angles_rad").noconvert(),
          nb::arg("max_range_m"), nb::arg("time_s") = 0.0);
    m.def("seen", &seen_of, nb::arg("world"), nb::arg("crowd").none(), nb::arg("people").noconvert(),
          nb::arg("time_s"));
    m.def("clearance", &clearance_many, nb::arg("world"), nb::arg("poses").noconvert(), nb::arg("radius_m"),
          nb::arg("footprint").noconvert(), nb::arg("limit_m"), nb::arg("time_s") = 0.0);
    m.def("clearance_field", &clearance_field_of, nb::arg("world"), nb::arg("origin_x_m"), nb::arg("origin_y_m"),
          nb::arg("width"), nb::arg("height"), nb::arg("resolution_m"), nb::arg("limit_m"));
    m.def("distance_field", &distance_field_of, nb::arg("solid").noconvert(), nb::arg("resolution_m"));
    m.def("astar", &astar_on, nb::arg("blocked").noconvert(), nb::arg("start"), nb::arg("goal"));
    m.def("shorten_path", &shorten_path_on, nb::arg("blocked").noconvert(), nb::arg("cells").noconvert());
    m.def("integrate", &integrate_many, nb::arg("poses").noconvert(), nb::arg("twists").noconvert(), nb::arg("dt_s"));
    bind_control(m);
    bind_batch_sim(m);
    bind_braking(m);
    bind_car(m);
    bind_misfit(m);
    bind_replanner(m);
    bind_scans(m);
}
