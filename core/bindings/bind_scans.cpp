// What is read out of scans, of robots of several kinds side by side: sectors, and what moves.
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "kinds.hpp"
#include "world/motion_cue.hpp"
#include "world/sectors.hpp"
#include "world/tracker.hpp"

using namespace adrl;

namespace {

using Scans = In<float, nb::shape<-1, -1>>;
using Numbers = Out<float, nb::shape<-1, -1>>;

Pose pose_at(const In<double, Rows3> &poses, std::size_t i) { return {poses(i, 0), poses(i, 1), poses(i, 2)}; }

std::shared_ptr<SectorTable> make_sectors(const In<std::int32_t, nb::shape<-1>> &beams,
                                          const In<std::int32_t, nb::shape<-1>> &first, int num_beams,
                                          double max_range) {
    for (const std::int32_t beam : view(beams)) {
        if (beam < 0 || beam >= num_beams) throw nb::value_error("beams: give 0 to num_beams - 1");
    }
    const auto bounds = view(first);
    if (bounds.size() < 2 || bounds.front() != 0 || bounds.back() != static_cast<std::int32_t>(beams.size()) ||
        !std::is_sorted(bounds.begin(), bounds.end()))
        throw nb::value_error("first: give 0, rising up to the number of beams");
    const auto all = view(beams);
    return std::make_shared<SectorTable>(SectorTable{
        {all.begin(), all.end()}, {bounds.begin(), bounds.end()}, num_beams, static_cast<float>(max_range)});
}

// One thing a kind, all of one size, and rows (N) of them.
template <class T>
struct OfKinds {
    std::vector<std::shared_ptr<T>> kinds;

    void require(const Kinds &kind, const Scans &ranges) const {
        if (kind.shape(0) != ranges.shape(0)) throw nb::value_error("kind: give one a row");
        require_kinds(kind.data(), kind.shape(0), kinds.size());
        for (const std::int64_t k : view(kind)) {
            if (static_cast<std::size_t>(beams_of(*kinds[k])) > ranges.shape(1))
                throw nb::value_error("ranges: give a column for every beam");
        }
    }
    static int beams_of(const SectorTable &table) { return table.num_beams; }
    static int beams_of(const MotionCue &cue) { return cue.num_beams(); }
    static int beams_of(const NearestTracks &tracks) { return tracks.num_beams(); }
};

std::size_t sectors_of(const SectorTable &table) { return table.first.size() - 1; }
std::size_t sectors_of(const NearestTracks &tracks) { return static_cast<std::size_t>(tracks.num_tracks()); }
std::size_t sectors_of(const MotionCue &cue) { return static_cast<std::size_t>(cue.num_sectors()); }

template <class T>
std::unique_ptr<OfKinds<T>> make_kinds(std::vector<std::shared_ptr<T>> kinds) {
    if (kinds.empty()) throw nb::value_error("give one kind or more");
    for (const auto &kind : kinds) {
        if (sectors_of(*kind) != sectors_of(*kinds.front())) throw nb::value_error("kinds differ in num_sectors");
    }
    return std::make_unique<OfKinds<T>>(OfKinds<T>{std::move(kinds)});
}

void nearest(const OfKinds<SectorTable> &self, const Kinds &kind, const Scans &ranges, Numbers out) {
    self.require(kind, ranges);
    const std::size_t n = ranges.shape(0), sectors = sectors_of(*self.kinds.front());
    if (out.shape(0) != n || out.shape(1) != sectors) throw nb::value_error("out: (N, num_sectors)");
    const nb::gil_scoped_release release;
    for (std::size_t i = 0; i < n; ++i) {
        nearest_of_sectors(*self.kinds[kind.data()[i]], ranges.data() + i * ranges.shape(1), out.data() + i * sectors);
    }
}

std::shared_ptr<MotionCue> make_motion_cue(int num_beams, double angle_min, double increment,
                                           std::tuple<double, double, double> mount, double max_range, int num_sectors,
                                           double margin, double scale) {
    const auto [x, y, yaw] = mount;
    require_finite({angle_min, increment, x, y, yaw, max_range, margin, scale}, "motion cue");
    if (num_beams < 1 || num_beams > 2048) throw nb::value_error("num_beams: give 1 to 2048");
    if (num_sectors < 1 || num_sectors > 2048) throw nb::value_error("num_sectors: give 1 to 2048");
    if (!(increment > 0.0 && scale > 0.0)) throw nb::value_error("angle_increment_rad or scale_m is not positive");
    return std::make_shared<MotionCue>(
        CueConfig{num_beams, angle_min, increment, {x, y, yaw}, max_range, num_sectors, margin, scale});
}

void compute(const OfKinds<MotionCue> &self, const Kinds &kind, const Scans &ranges, const In<double, Rows3> &poses,
             const Scans &past_ranges, const In<double, Rows3> &past_poses, Numbers out) {
    self.require(kind, ranges);
    const std::size_t n = ranges.shape(0), beams = ranges.shape(1), sectors = sectors_of(*self.kinds.front());
    if (past_ranges.shape(1) != beams) throw nb::value_error("past_ranges: as many columns as ranges");
    if (past_ranges.shape(0) != n || poses.shape(0) != n || past_poses.shape(0) != n || out.shape(0) != n)
        throw nb::value_error("ranges, poses and out differ in length");
    if (out.shape(1) != sectors) throw nb::value_error("out: (N, num_sectors)");
    require_all_finite(poses, "poses");
    require_all_finite(past_poses, "past_poses");
    const nb::gil_scoped_release release;
    for (std::size_t i = 0; i < n; ++i) {
        self.kinds[kind.data()[i]]->compute(ranges.data() + i * beams, pose_at(poses, i),
                                            past_ranges.data() + i * beams, pose_at(past_poses, i),
                                            out.data() + i * sectors);
    }
}

void compute_one(const std::shared_ptr<MotionCue> &cue, const Scans &ranges, const In<double, Rows3> &poses,
                 const Scans &past_ranges, const In<double, Rows3> &past_poses, Numbers out) {
    if (ranges.shape(1) != static_cast<std::size_t>(cue->num_beams())) throw nb::value_error("ranges: (N, num_beams)");
    const std::vector<std::int64_t> kind(ranges.shape(0), 0);
    compute({{cue}}, Kinds(kind.data(), {kind.size()}), ranges, poses, past_ranges, past_poses, out);
}

std::shared_ptr<NearestTracks> make_tracks(int num_beams, double angle_min, double increment,
                                           std::tuple<double, double, double> mount, double max_range, double period_s,
                                           int num_tracks) {
    const auto [x, y, yaw] = mount;
    require_finite({angle_min, increment, x, y, yaw, max_range, period_s}, "tracks");
    if (num_beams < 1) throw nb::value_error("num_beams: give 1 or more");
    if (num_tracks < 1) throw nb::value_error("num_tracks: give 1 or more");
    if (!(increment > 0.0 && period_s > 0.0)) throw nb::value_error("increment or period_s is not positive");
    return std::make_shared<NearestTracks>(
        TracksConfig{num_beams, angle_min, increment, {x, y, yaw}, max_range, period_s, num_tracks});
}

// Scans (S, N, K) and poses (S, N, 3) of N robots are a ring, whose newest is `newest`; the last `count` are looked at.
void follow(const OfKinds<NearestTracks> &self, const Kinds &kind, const In<float, nb::shape<-1, -1, -1>> &ranges,
            const In<double, nb::shape<-1, -1, 3>> &poses, std::int64_t newest, std::size_t count,
            Out<float, nb::shape<-1, -1, kNumbersOfTrack>> out) {
    const std::size_t ring = ranges.shape(0), n = ranges.shape(1), beams = ranges.shape(2);
    const std::size_t numbers = sectors_of(*self.kinds.front()) * kNumbersOfTrack;
    if (poses.shape(0) != ring || poses.shape(1) != n) throw nb::value_error("ranges and poses differ in shape");
    if (out.shape(0) != n || out.shape(1) * kNumbersOfTrack != numbers) throw nb::value_error("out: (N, tracks, 5)");
    if (newest < 0 || static_cast<std::size_t>(newest) >= ring) throw nb::value_error("newest: give 0 to S - 1");
    if (count < 1 || count > ring) throw nb::value_error("count: give 1 to S");
    if (kind.shape(0) != n) throw nb::value_error("kind: give one a row");
    require_kinds(kind.data(), n, self.kinds.size());
    for (const std::int64_t k : view(kind)) {
        if (static_cast<std::size_t>(self.kinds[k]->num_beams()) > beams)
            throw nb::value_error("ranges: give a column for every beam");
    }
    require_all_finite(poses, "poses");
    const nb::gil_scoped_release release;
    std::vector<const float *> scans(count);
    std::vector<Pose> places(count);
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < count; ++k) {
            const std::size_t row = (static_cast<std::size_t>(newest) + ring + 1 - count + k) % ring * n + i;
            const double *pose = poses.data() + row * 3;
            scans[k] = ranges.data() + row * beams;
            places[k] = {pose[0], pose[1], pose[2]};
        }
        self.kinds[kind.data()[i]]->compute(scans, places, out.data() + i * numbers);
    }
}

using Row = nb::shape<-1>;

// (H, 2) velocities of the hits, 0 of what stands, and (H) how broad what was ever seen to move is, else infinity.
std::tuple<Returned<double>, Returned<double>>
take(Tracker &self, double stamp_s, std::tuple<double, double, double> sensor, double angle_min, double increment,
     const In<double, Row> &seen, const In<std::int32_t, Row> &beams, const In<double, Rows2> &points) {
    const auto [x, y, yaw] = sensor;
    require_finite({stamp_s, x, y, yaw, angle_min, increment}, "scan");
    if (increment == 0.0) throw nb::value_error("increment is 0");
    if (beams.size() != points.shape(0)) throw nb::value_error("beams and points differ in length");
    for (std::size_t i = 0; i < beams.size(); ++i) {
        if (beams.data()[i] < (i > 0 ? beams.data()[i - 1] + 1 : 0) || beams.data()[i] >= static_cast<int>(seen.size()))
            throw nb::value_error("beams: give rising numbers of beams");
    }
    require_all_finite(seen, "seen");
    require_all_finite(points, "points");
    std::vector<Vec2> hits;
    for (std::size_t i = 0; i < points.shape(0); ++i) hits.push_back({points(i, 0), points(i, 1)});
    self.take({stamp_s, {x, y, yaw}, angle_min, increment, view(seen), view(beams), hits});
    double *velocity = nullptr, *breadth = nullptr;
    auto velocities = new_array<double>({hits.size(), 2}, velocity);
    auto breadths = new_array<double>({hits.size()}, breadth);
    for (std::size_t i = 0; i < hits.size(); ++i) {
        const int number = self.track_of_hit()[i];
        const Track *track = number < 0 ? nullptr : &self.track(number);
        const Vec2 v = track != nullptr && track->moves(stamp_s) ? track->velocity() : Vec2{};
        velocity[2 * i] = v.x;
        velocity[2 * i + 1] = v.y;
        breadth[i] =
            track != nullptr && track->has_moved() ? track->breadth() : std::numeric_limits<double>::infinity();
    }
    return {velocities, breadths};
}

} // namespace

void bind_scans(nb::module_ &m) {
    nb::class_<SectorTable>(m, "SectorTable")
        .def(nb::new_(&make_sectors), nb::arg("beams").noconvert(), nb::arg("first").noconvert(), nb::arg("num_beams"),
             nb::arg("max_range_m"));
    nb::class_<OfKinds<SectorTable>>(m, "Sectors")
        .def(nb::new_(&make_kinds<SectorTable>), nb::arg("kinds"))
        .def("nearest", &nearest, nb::arg("kind").noconvert(), nb::arg("ranges").noconvert(),
             nb::arg("out").noconvert());
    nb::class_<MotionCue>(m, "MotionCue")
        .def(nb::new_(&make_motion_cue), nb::arg("num_beams"), nb::arg("angle_min_rad"), nb::arg("angle_increment_rad"),
             nb::arg("mount"), nb::arg("max_range_m"), nb::arg("num_sectors"), nb::arg("margin_m"), nb::arg("scale_m"))
        .def("compute", &compute_one, nb::arg("ranges").noconvert(), nb::arg("poses").noconvert(),
             nb::arg("past_ranges").noconvert(), nb::arg("past_poses").noconvert(), nb::arg("out").noconvert());
    nb::class_<OfKinds<MotionCue>>(m, "MotionCues")
        .def(nb::new_(&make_kinds<MotionCue>), nb::arg("kinds"))
        .def("compute", &compute, nb::arg("kind").noconvert(), nb::arg("ranges").noconvert(),
             nb::arg("poses").noconvert(), nb::arg("past_ranges").noconvert(), nb::arg("past_poses").noconvert(),
             nb::arg("out").noconvert());
    nb::class_<NearestTracks>(m, "NearestTracks")
        .def(nb::new_(&make_tracks), nb::arg("num_beams"), nb::arg("angle_min_rad"), nb::arg("angle_increment_rad"),
             nb::arg("mount"), nb::arg("max_range_m"), nb::arg("period_s"), nb::arg("num_tracks"));
    nb::class_<OfKinds<NearestTracks>>(m, "NearestTracksOfKinds")
        .def(nb::new_(&make_kinds<NearestTracks>), nb::arg("kinds"))
        .def("compute", &follow, nb::arg("kind").noconvert(), nb::arg("ranges").noconvert(),
             nb::arg("poses").noconvert(), nb::arg("newest"), nb::arg("count"), nb::arg("out").noconvert());
    nb::class_<Tracker>(m, "Tracker")
        .def(nb::init<>())
        .def("forget", &Tracker::forget)
        .def("take", &take, nb::arg("stamp_s"), nb::arg("sensor"), nb::arg("angle_min_rad"),
             nb::arg("angle_increment_rad"), nb::arg("seen").noconvert(), nb::arg("beams").noconvert(),
             nb::arg("points").noconvert());
}
