#include "world/raycast.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace adrl {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kTwoPi = 2.0 * kPi;
// Brackets of beams are widened by this much; the arc tangent below is good to 2e-5, and the exact test decides.
constexpr double kBracketSlack = 1e-4;
// Two walls that share a corner must not let a beam slip between them by rounding.
constexpr double kCornerSlack = 1e-12;
// A beam within this angle of a segment's own direction passes it by: where it would hit is all rounding.
constexpr double kParallel = 1e-9;
// Obstacles are handled in chunks of this many, so that scratch space stays on the stack.
constexpr int kChunk = 64;

// The sensor's frame: obstacles are brought into it once instead of turning every beam.
struct Frame {
    double x, y, c, s;
    explicit Frame(const Pose &p) : x(p.x), y(p.y), c(std::cos(p.theta)), s(std::sin(p.theta)) {}
};

// The beams that may meet an obstacle: [first, last], and [0, wrapped] where its bracket runs past the scan's end.
struct Brackets {
    double first[kChunk], last[kChunk], wrapped[kChunk]; // to be cut to whole beams; none where wrapped < 0
};

struct CircleChunk { // in the sensor's frame
    double x[kChunk], y[kChunk];
    double power[kChunk]; // squared distance to the centre minus squared radius: below 0 inside
    double reach[kChunk]; // distance to the circle
    Brackets beams;
};

struct SegmentChunk { // in the sensor's frame
    double ax[kChunk], ay[kChunk], bx[kChunk], by[kChunk];
    double side[kChunk]; // cross(a, b): below 0 when the sensor sees the front of a counter-clockwise edge
    double reach[kChunk];
    Brackets beams;
};

// Beams as real numbers: beam i is at i, a full turn is `turn` of them.
struct BeamScale {
    double angle_min, per_radian, turn;
    double last; // number of the last beam
    explicit BeamScale(const Beams &beams)
        : angle_min(beams.angle_min()), per_radian(beams.increment() > 0.0 ? 1.0 / beams.increment() : 0.0),
          turn(kTwoPi * per_radian), last(beams.count() - 1) {}
};

// Nearer than this an obstacle may span half a turn, where its bracket means nothing: every beam is tested.
constexpr double kClose = 1e-6;

// Beams of the bracket of angles [from, to] into row i.
ADRL_INLINE void bracket(Brackets &out, int i, double from, double to, double reach, const BeamScale &scale) {
    const double width = (to - from + 2.0 * kBracketSlack) * scale.per_radian;
    double begin = (from - kBracketSlack - scale.angle_min) * scale.per_radian;
    begin = begin < 0.0 ? begin + scale.turn : begin;
    begin = begin < 0.0 ? begin + scale.turn : begin;
    begin = begin >= scale.turn ? begin - scale.turn : begin;
    const double end = begin + width;
    const double over = end - scale.turn;
    const double wrapped = over > scale.last ? scale.last : over;
    const double last = end > scale.last ? scale.last : end;
    const bool close = reach < kClose;
    out.first[i] = close ? 0.0 : begin;
    out.last[i] = close ? scale.last : last;
    out.wrapped[i] = close ? -1.0 : wrapped;
}

ADRL_CLONES void prepare_circles(const double *cx, const double *cy, const double *radius, int padded,
                                 const Frame &frame, const BeamScale &scale, CircleChunk &out) {
    for (int i = 0; i < padded; ++i) {
        const double gx = cx[i] - frame.x;
        const double gy = cy[i] - frame.y;
        const double rx = frame.c * gx + frame.s * gy;
        const double ry = frame.c * gy - frame.s * gx;
        const double d2 = rx * rx + ry * ry;
        const double power = d2 - radius[i] * radius[i];
        const double tangent = std::sqrt(power > 0.0 ? power : 0.0);
        const double centre = rough_atan2(ry, rx);
        const double half = rough_atan2(radius[i], tangent);
        out.x[i] = rx;
        out.y[i] = ry;
        out.power[i] = power;
        out.reach[i] = std::sqrt(d2) - radius[i];
        bracket(out.beams, i, centre - half, centre + half, out.reach[i], scale);
    }
}

ADRL_CLONES void place_segments(const double *ax, const double *ay, const double *bx, const double *by, int padded,
                                const Frame &frame, SegmentChunk &out) {
    for (int i = 0; i < padded; ++i) {
        const double gax = ax[i] - frame.x;
        const double gay = ay[i] - frame.y;
        const double gbx = bx[i] - frame.x;
        const double gby = by[i] - frame.y;
        const double rax = frame.c * gax + frame.s * gay;
        const double ray = frame.c * gay - frame.s * gax;
        const double rbx = frame.c * gbx + frame.s * gby;
        const double rby = frame.c * gby - frame.s * gbx;
        const double ex = rbx - rax;
        const double ey = rby - ray;
        double u = -(rax * ex + ray * ey) / (ex * ex + ey * ey + 1e-300);
        u = u < 0.0 ? 0.0 : u;
        u = u > 1.0 ? 1.0 : u;
        const double nx = rax + u * ex;
        const double ny = ray + u * ey;
        out.ax[i] = rax;
        out.ay[i] = ray;
        out.bx[i] = rbx;
        out.by[i] = rby;
        out.side[i] = rax * rby - ray * rbx;
        out.reach[i] = std::sqrt(nx * nx + ny * ny);
    }
}

// Keeps the segments a beam can reach, of polygons the edges whose front is seen; returns how many.
int keep_seen(SegmentChunk &chunk, int count, double max_range, bool one_sided) {
    int kept = 0;
    for (int i = 0; i < count; ++i) { // without branches: half of them would be guessed wrong
        chunk.ax[kept] = chunk.ax[i];
        chunk.ay[kept] = chunk.ay[i];
        chunk.bx[kept] = chunk.bx[i];
        chunk.by[kept] = chunk.by[i];
        chunk.reach[kept] = chunk.reach[i];
        kept += static_cast<int>((chunk.reach[i] < max_range) & (!one_sided | (chunk.side[i] < 0.0)));
    }
    return kept;
}

ADRL_CLONES void bracket_segments(SegmentChunk &chunk, int padded, const BeamScale &scale) {
    for (int i = 0; i < padded; ++i) {
        const double angle_a = rough_atan2(chunk.ay[i], chunk.ax[i]);
        const double angle_b = rough_atan2(chunk.by[i], chunk.bx[i]);
        const double low = angle_a < angle_b ? angle_a : angle_b;
        const double high = angle_a < angle_b ? angle_b : angle_a;
        // A segment never spans more than pi as seen from a point: a wider gap means the other way round.
        const bool across = high - low > kPi;
        bracket(chunk.beams, i, across ? high : low, across ? low + kTwoPi : high, chunk.reach[i], scale);
    }
}

// An obstacle of the chunk and the beams [first, last) to test against it, in whole blocks of kLanes.
struct Jobs {
    int obstacle[2 * kChunk + 2], first[2 * kChunk + 2], last[2 * kChunk + 2];
    int count = 0;

    explicit Jobs(const Beams &beams) : bracketed_(beams.uniform() && beams.increment() > 0.0), end_(beams.padded()) {}

    void add(const Brackets &beams, int i) {
        if (!bracketed_) {
            put(i, 0, end_ - 1);
            return;
        }
        // Beams are tested in blocks anyway, so the first is rounded down.
        put(i, static_cast<int>(beams.first[i]), static_cast<int>(beams.last[i]));
        put(i, beams.wrapped[i] < 0.0 ? 1 : 0, beams.wrapped[i] < 0.0 ? 0 : static_cast<int>(beams.wrapped[i]));
    }

  private:
    void put(int i, int from, int to) {
        obstacle[count] = i;
        first[count] = from / kLanes * kLanes;
        last[count] = (to / kLanes + 1) * kLanes;
        count += static_cast<int>(from <= to);
    }

    bool bracketed_;
    int end_;
};

ADRL_CLONES void cast_circle_jobs(const CircleChunk &chunk, const Jobs &jobs, const double *dx, const double *dy,
                                  double *ranges) {
    for (int j = 0; j < jobs.count; ++j) {
        const double x = chunk.x[jobs.obstacle[j]];
        const double y = chunk.y[jobs.obstacle[j]];
        const double power = chunk.power[jobs.obstacle[j]];
        for (int i = jobs.first[j]; i < jobs.last[j]; i += kLanes) {
            for (int k = 0; k < kLanes; ++k) {
                const double along = dx[i + k] * x + dy[i + k] * y;
                const double under = along * along - power;
                const double hit = along - std::sqrt(under > 0.0 ? under : 0.0);
                const bool nearer = (under >= 0.0) & (hit >= 0.0) & (hit < ranges[i + k]);
                ranges[i + k] = nearer ? hit : ranges[i + k];
            }
        }
    }
}

ADRL_CLONES void cast_segment_jobs(const SegmentChunk &chunk, const Jobs &jobs, const double *dx, const double *dy,
                                   double *ranges) {
    for (int j = 0; j < jobs.count; ++j) {
        const double ax = chunk.ax[jobs.obstacle[j]];
        const double ay = chunk.ay[jobs.obstacle[j]];
        const double ex = chunk.bx[jobs.obstacle[j]] - ax;
        const double ey = chunk.by[jobs.obstacle[j]] - ay;
        const double side = ax * ey - ay * ex;
        const double parallel = kParallel * std::sqrt(ex * ex + ey * ey);
        for (int i = jobs.first[j]; i < jobs.last[j]; i += kLanes) {
            for (int k = 0; k < kLanes; ++k) {
                const double across = dx[i + k] * ey - dy[i + k] * ex;
                const double inverse = 1.0 / across;
                const double hit = side * inverse;
                const double u = (ax * dy[i + k] - ay * dx[i + k]) * inverse;
                const bool nearer = (std::abs(across) > parallel) & (hit >= 0.0) & (u >= -kCornerSlack) &
                                    (u <= 1.0 + kCornerSlack) & (hit < ranges[i + k]);
                ranges[i + k] = nearer ? hit : ranges[i + k];
            }
        }
    }
}

int padded_to_lanes(int count) { return (count + kLanes - 1) / kLanes * kLanes; }

// False when the sensor is inside a circle.
bool cast_circles(const double *x, const double *y, const double *radius, int count, const Frame &frame,
                  const Beams &beams, double max_range, double *ranges) {
    const BeamScale scale(beams);
    CircleChunk chunk;
    for (int first = 0; first < count; first += kChunk) {
        const int here = std::min(kChunk, count - first);
        prepare_circles(x + first, y + first, radius + first, padded_to_lanes(here), frame, scale, chunk);
        Jobs jobs(beams);
        for (int i = 0; i < here; ++i) {
            if (chunk.reach[i] >= max_range) continue;
            if (chunk.power[i] <= 0.0) return false;
            jobs.add(chunk.beams, i);
        }
        cast_circle_jobs(chunk, jobs, beams.dx(), beams.dy(), ranges);
    }
    return true;
}

// one_sided: edges of polygons, seen from outside only.
void cast_segments(const Segments &segments, bool one_sided, const Frame &frame, const Beams &beams, double max_range,
                   double *ranges) {
    const BeamScale scale(beams);
    SegmentChunk chunk;
    for (int first = 0; first < segments.count; first += kChunk) {
        const int here = std::min(kChunk, segments.count - first);
        place_segments(&segments.ax[first], &segments.ay[first], &segments.bx[first], &segments.by[first],
                       padded_to_lanes(here), frame, chunk);
        const int kept = keep_seen(chunk, here, max_range, one_sided);
        bracket_segments(chunk, padded_to_lanes(kept), scale);
        Jobs jobs(beams);
        for (int i = 0; i < kept; ++i) jobs.add(chunk.beams, i);
        cast_segment_jobs(chunk, jobs, beams.dx(), beams.dy(), ranges);
    }
}

// Part of a ray inside [0, limit], as parameters; empty when from > to.
void clip(double origin, double direction, double limit, double &from, double &to) {
    if (direction == 0.0) {
        if (origin < 0.0 || origin > limit) to = -1.0;
        return;
    }
    const double t0 = -origin / direction;
    const double t1 = (limit - origin) / direction;
    from = std::max(from, std::min(t0, t1));
    to = std::min(to, std::max(t0, t1));
}

// Length in cells from `origin` along the unit `direction` to the first solid cell; infinity when there is none.
// Cell by cell (Amanatides and Woo 1987), but where the next solid cell is `jump` cells off, over the whole box of
// free cells at once. The hit is the border crossing itself, so jumps do not change it.
double cast_bitmap_ray(const Bitmap &bitmap, Vec2 origin, Vec2 direction, double limit) {
    double t = 0.0;
    double end = limit;
    clip(origin.x, direction.x, bitmap.width, t, end);
    clip(origin.y, direction.y, bitmap.height, t, end);
    if (t > end) return std::numeric_limits<double>::infinity();
    const int step_x = direction.x > 0.0 ? 1 : -1;
    const int step_y = direction.y > 0.0 ? 1 : -1;
    const double inverse_x = 1.0 / direction.x;
    const double inverse_y = 1.0 / direction.y;
    int x = std::clamp(static_cast<int>(std::floor(origin.x + t * direction.x)), 0, bitmap.width - 1);
    int y = std::clamp(static_cast<int>(std::floor(origin.y + t * direction.y)), 0, bitmap.height - 1);
    while (t <= end) {
        const int jump = bitmap.jump[static_cast<std::size_t>(y) * bitmap.width + x];
        if (jump == 0) return t;
        const int out_x = step_x > 0 ? x + jump : x - jump; // first column beyond the free box
        const int out_y = step_y > 0 ? y + jump : y - jump;
        const double border_x = step_x > 0 ? out_x : out_x + 1;
        const double border_y = step_y > 0 ? out_y : out_y + 1;
        const double t_x = direction.x != 0.0 ? (border_x - origin.x) * inverse_x : kFarAway;
        const double t_y = direction.y != 0.0 ? (border_y - origin.y) * inverse_y : kFarAway;
        if (t_x < t_y) {
            t = t_x;
            x = out_x;
            y = std::clamp(static_cast<int>(std::floor(origin.y + t * direction.y)), y - jump + 1, y + jump - 1);
        } else {
            t = t_y;
            y = out_y;
            x = std::clamp(static_cast<int>(std::floor(origin.x + t * direction.x)), x - jump + 1, x + jump - 1);
        }
        if (x < 0 || y < 0 || x >= bitmap.width || y >= bitmap.height) break;
    }
    return std::numeric_limits<double>::infinity();
}

void cast_bitmap(const Bitmap &bitmap, const Pose &sensor, const Beams &beams, double *ranges) {
    const Vec2 origin = bitmap.to_cells({sensor.x, sensor.y});
    const double c = std::cos(sensor.theta - bitmap.origin.theta);
    const double s = std::sin(sensor.theta - bitmap.origin.theta);
    for (int i = 0; i < beams.count(); ++i) {
        const Vec2 direction{c * beams.dx()[i] - s * beams.dy()[i], s * beams.dx()[i] + c * beams.dy()[i]};
        const double cells = cast_bitmap_ray(bitmap, origin, direction, ranges[i] / bitmap.resolution);
        ranges[i] = std::min(ranges[i], cells * bitmap.resolution);
    }
}

} // namespace

Beams::Beams(const std::vector<double> &angles) : count_(static_cast<int>(angles.size())) { point(angles); }

Beams::Beams(int count, double angle_min, double increment)
    : count_(count), uniform_(increment > 1e-6 && (count - 1) * increment <= kTwoPi), angle_min_(wrap_angle(angle_min)),
      increment_(increment) {
    std::vector<double> angles(count);
    for (int i = 0; i < count; ++i) angles[i] = angle_min + i * increment;
    point(angles);
}

void Beams::point(const std::vector<double> &angles) {
    const std::size_t padded = (angles.size() + kLanes - 1) / kLanes * kLanes;
    dx_.assign(padded, 1.0);
    dy_.assign(padded, 0.0);
    for (std::size_t i = 0; i < angles.size(); ++i) {
        dx_[i] = std::cos(angles[i]);
        dy_[i] = std::sin(angles[i]);
    }
}

void raycast(const World &world, const DiscPlaces &discs, const Pose &sensor, const Beams &beams, double max_range,
             double *ranges) {
    const Frame frame(sensor);
    const Circles &circles = world.circles();
    std::fill(ranges, ranges + beams.padded(), max_range);
    const bool outside = !inside_polygon(world, {sensor.x, sensor.y}) &&
                         cast_circles(circles.x.data(), circles.y.data(), circles.radius.data(), circles.count, frame,
                                      beams, max_range, ranges) &&
                         cast_circles(discs.x, discs.y, discs.radius, discs.count, frame, beams, max_range, ranges);
    if (!outside) {
        std::fill(ranges, ranges + beams.padded(), 0.0);
        return;
    }
    cast_segments(world.edges(), true, frame, beams, max_range, ranges);
    cast_segments(world.walls(), false, frame, beams, max_range, ranges);
    if (!world.bitmap().empty()) cast_bitmap(world.bitmap(), sensor, beams, ranges);
}

} // namespace adrl
