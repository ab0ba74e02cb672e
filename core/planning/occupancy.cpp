#include "planning/occupancy.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <numbers>

namespace adrl {
namespace {

std::int64_t lattice(double metres, double resolution) {
    return static_cast<std::int64_t>(std::floor(metres / resolution));
}

// Moves the cells by whole rows and columns; cells that come in are unknown.
void shift(std::int8_t *cells, const WindowShape &shape, std::int64_t down, std::int64_t left) {
    const std::int64_t height = shape.height;
    const std::int64_t width = shape.width;
    if (std::abs(down) >= height || std::abs(left) >= width) {
        std::memset(cells, 0, static_cast<std::size_t>(height * width));
        return;
    }
    const std::int64_t kept = width - std::abs(left);
    const std::int64_t to = std::max<std::int64_t>(0, -left);
    const std::int64_t from = std::max<std::int64_t>(0, left);
    const auto move_row = [&](std::int64_t row) {
        std::int8_t *out = cells + row * width;
        const std::int64_t source = row + down;
        if (source < 0 || source >= height) {
            std::memset(out, 0, static_cast<std::size_t>(width));
            return;
        }
        std::memmove(out + to, cells + source * width + from, static_cast<std::size_t>(kept));
        if (to > 0) std::memset(out, 0, static_cast<std::size_t>(to));
        if (to + kept < width) std::memset(out + to + kept, 0, static_cast<std::size_t>(width - to - kept));
    };
    // A row is read before it is written.
    if (down >= 0) {
        for (std::int64_t row = 0; row < height; ++row) move_row(row);
    } else {
        for (std::int64_t row = height - 1; row >= 0; --row) move_row(row);
    }
}

// A beam sees no farther than its two neighbours.
double free_range(const Scanner &scanner, const float *ranges, int i) {
    const int last = static_cast<int>(scanner.local_x.size()) - 1;
    const auto at = [&](int k) { return ranges[k] > 0.0F ? static_cast<double>(ranges[k]) : 0.0; };
    const double before = i > 0 ? at(i - 1) : (scanner.full_circle ? at(last) : at(i));
    const double after = i < last ? at(i + 1) : (scanner.full_circle ? at(0) : at(i));
    return std::min({before, at(i), after, scanner.reach});
}

std::int8_t hit(std::int8_t cell, const Evidence &evidence) {
    const int once_free = cell & 1;
    return static_cast<std::int8_t>(std::min(cell + 2 * evidence.hit, evidence.wall() - once_free));
}

std::int8_t missed(std::int8_t cell, const Evidence &evidence) {
    const int less = cell - 2 * evidence.miss;
    return less <= 2 * evidence.low ? evidence.free() : static_cast<std::int8_t>(less);
}

} // namespace

void clear_window(std::int8_t *log_odds, const WindowShape &shape, WindowOrigin &origin, Vec2 robot) {
    std::memset(log_odds, 0, static_cast<std::size_t>(shape.height) * shape.width);
    origin = {lattice(robot.y, shape.resolution) - shape.height / 2,
              lattice(robot.x, shape.resolution) - shape.width / 2};
}

void follow_robot(std::int8_t *log_odds, const WindowShape &shape, WindowOrigin &origin, Vec2 robot) {
    const std::int64_t row = lattice(robot.y, shape.resolution) - origin.row;
    const std::int64_t column = lattice(robot.x, shape.resolution) - origin.column;
    // How far to move, so that it need not be done again at once.
    const auto beyond = [](std::int64_t at, int side) -> std::int64_t {
        const int border = side / 4;
        if (at < border) return at - border - side / 16;
        return at >= side - border ? at - (side - 1 - border) + side / 16 : 0;
    };
    const std::int64_t down = beyond(row, shape.height);
    const std::int64_t left = beyond(column, shape.width);
    if (down == 0 && left == 0) return;
    shift(log_odds, shape, down, left);
    origin.row += down;
    origin.column += left;
}

bool corridor_seen_free(const std::int8_t *log_odds, const WindowShape &shape, const WindowOrigin &origin, Vec2 from,
                        Vec2 to, double radius, bool known) {
    // In cells, (0, 0) the centre of the window's first one.
    const double inverse = 1.0 / shape.resolution;
    const auto in_window = [&](Vec2 p) {
        return Vec2{p.x * inverse - static_cast<double>(origin.column) - 0.5,
                    p.y * inverse - static_cast<double>(origin.row) - 0.5};
    };
    const Vec2 a = in_window(from);
    const Vec2 b = in_window(to);
    const double wide = radius * inverse;
    const double length = norm(b - a);
    const Vec2 along = length > 0.0 ? (1.0 / length) * (b - a) : Vec2{1.0, 0.0};
    const auto rows_from = static_cast<int>(std::max(0.0, std::ceil(std::min(a.y, b.y) - wide)));
    const auto rows_to = static_cast<int>(std::min(shape.height - 1.0, std::floor(std::max(a.y, b.y) + wide)));
    const auto least_x = std::min(a.x, b.x) - wide;
    const auto most_x = std::max(a.x, b.x) + wide;
    // Calls visit(offset from a) for the solid cells of the corridor, until it returns false.
    const auto each_solid = [&](double reach, auto &&visit) {
        for (int row = rows_from; row <= rows_to; ++row) {
            double low = least_x;
            double high = most_x;
            if (std::abs(along.y) > 1e-6) { // the strip of half width `wide` about the line cuts the row here
                const double middle = a.x + along.x * (row - a.y) / along.y;
                const double half = wide / std::abs(along.y);
                low = std::max(low, middle - half);
                high = std::min(high, middle + half);
            }
            const auto first = static_cast<int>(std::max(0.0, std::ceil(std::max(low, a.x - reach))));
            const auto last = static_cast<int>(std::min(shape.width - 1.0, std::floor(std::min(high, a.x + reach))));
            const std::int8_t *cells = log_odds + static_cast<std::ptrdiff_t>(row) * shape.width;
            for (int column = first; column <= last; ++column) {
                if (cells[column] > 0 && !visit(Vec2{column - a.x, row - a.y})) return false;
            }
        }
        return true;
    };
    if (known) {
        const int steps = static_cast<int>(std::ceil(length));
        for (int k = 1; k <= steps; ++k) {
            const Vec2 at = a + (static_cast<double>(k) / steps) * (b - a);
            const double row = std::floor(at.y + 0.5);
            const double column = std::floor(at.x + 0.5);
            if (!(row >= 0.0 && column >= 0.0 && row < shape.height && column < shape.width)) return false;
            if (log_odds[static_cast<std::size_t>(row) * shape.width + static_cast<std::size_t>(column)] >= 0)
                return false;
        }
    }
    double around = wide; // distance from `from` to the nearest solid cell
    each_solid(wide, [&](Vec2 cell) {
        around = std::min(around, norm(cell));
        return true;
    });
    return each_solid(length + wide, [&](Vec2 cell) {
        const double ahead = std::clamp(dot(cell, along), 0.0, length);
        const double wanted = std::min(wide, around + 0.5 * ahead);
        const double away = norm(cell - ahead * along);
        return away >= wanted || (ahead == 0.0 && away >= around);
    });
}

Scanner::Scanner(const Evidence &counts, const Beams &beams, const Pose &at, double most, double wanted, double body)
    : evidence(counts), mount(at), max_range(most), reach(std::min(wanted, most)), body_radius(body),
      full_circle(beams.uniform() && beams.increment() * (beams.count() + 0.5) >= 2.0 * std::numbers::pi) {
    const double c = std::cos(mount.theta);
    const double s = std::sin(mount.theta);
    for (int i = 0; i < beams.count(); ++i) {
        local_x.push_back(c * beams.dx()[i] - s * beams.dy()[i]);
        local_y.push_back(s * beams.dx()[i] + c * beams.dy()[i]);
    }
}

ScanIntegrator::ScanIntegrator(const WindowShape &shape, int most_beams)
    : shape_(shape), mark_(static_cast<std::size_t>(shape.height) * shape.width) {
    directions_.reserve(most_beams);
}

void ScanIntegrator::integrate(const Scanner &scanner, std::int8_t *log_odds, const WindowOrigin &origin,
                               const Pose &robot, const float *ranges, int parity) {
    if (++epoch_ == 0) {
        std::fill(mark_.begin(), mark_.end(), 0);
        epoch_ = 1;
    }
    const double c = std::cos(robot.theta);
    const double s = std::sin(robot.theta);
    const int count = static_cast<int>(scanner.local_x.size());
    directions_.resize(count);
    for (int i = 0; i < count; ++i) {
        directions_[i] = {c * scanner.local_x[i] - s * scanner.local_y[i],
                          s * scanner.local_x[i] + c * scanner.local_y[i]};
    }
    const auto in_window = [&](Vec2 p) {
        return Vec2{p.x / shape_.resolution - static_cast<double>(origin.column),
                    p.y / shape_.resolution - static_cast<double>(origin.row)};
    };
    const Vec2 sensor = in_window(to_world(robot, {scanner.mount.x, scanner.mount.y}));
    enter_hits(scanner, log_odds, sensor, ranges);
    for (int i = parity & 1; i < count; i += 2) {
        // The cell before the hit may hold a part of what was hit.
        trace(scanner.evidence, log_odds, sensor, directions_[i],
              free_range(scanner, ranges, i) / shape_.resolution - 1.0);
    }
    free_body(scanner, log_odds, in_window({robot.x, robot.y}));
}

void ScanIntegrator::enter_hits(const Scanner &scanner, std::int8_t *log_odds, Vec2 sensor, const float *ranges) {
    const double limit = std::min(scanner.reach, scanner.max_range - 1e-4);
    for (std::size_t i = 0; i < directions_.size(); ++i) {
        const double range = ranges[i];
        if (!(range > 0.0 && range < limit)) continue;
        // Half a cell into the obstacle: noise then seldom thickens it towards the robot, and narrow gaps stay open.
        const Vec2 at = sensor + (range / shape_.resolution + 0.5) * directions_[i];
        if (!(at.x >= 0.0 && at.y >= 0.0 && at.x < shape_.width && at.y < shape_.height)) continue;
        const std::size_t cell =
            static_cast<std::size_t>(at.y) * static_cast<std::size_t>(shape_.width) + static_cast<std::size_t>(at.x);
        if (mark_[cell] == epoch_) continue;
        mark_[cell] = epoch_;
        log_odds[cell] = hit(log_odds[cell], scanner.evidence);
    }
}

void ScanIntegrator::trace(const Evidence &evidence, std::int8_t *log_odds, Vec2 sensor, Vec2 direction,
                           double length) {
    // One cell for every step of the longer axis.
    const double longer = std::max(std::abs(direction.x), std::abs(direction.y));
    const Vec2 step = (1.0 / longer) * direction;
    double steps = length * longer;
    const auto within = [&](double at, double by, double side) {
        if (by > 0.0) steps = std::min(steps, (side - 1e-3 - at) / by);
        if (by < 0.0) steps = std::min(steps, (at - 1e-3) / -by);
        return at >= 0.0 && at < side;
    };
    if (!within(sensor.x, step.x, shape_.width) || !within(sensor.y, step.y, shape_.height)) return;
    const int count = static_cast<int>(std::floor(steps));
    // 16 bits after the point: exact enough for 400 cells, and floor is a shift.
    constexpr double kOne = 65536.0;
    auto x = static_cast<std::int32_t>(sensor.x * kOne);
    auto y = static_cast<std::int32_t>(sensor.y * kOne);
    const auto dx = static_cast<std::int32_t>(step.x * kOne);
    const auto dy = static_cast<std::int32_t>(step.y * kOne);
    for (int k = 0; k <= count; ++k, x += dx, y += dy) {
        const std::size_t cell = static_cast<std::size_t>(y >> 16) * shape_.width + (x >> 16);
        if (mark_[cell] == epoch_) continue;
        mark_[cell] = epoch_;
        log_odds[cell] = missed(log_odds[cell], evidence);
    }
}

void ScanIntegrator::free_body(const Scanner &scanner, std::int8_t *log_odds, Vec2 robot) {
    const double radius = scanner.body_radius / shape_.resolution - 0.75; // whole cells under the robot only
    if (radius < 0.0) return;
    const auto first = [&](double at) { return std::max(0, static_cast<int>(std::floor(at - radius))); };
    const auto last = [&](double at, int side) {
        return std::min(side - 1, static_cast<int>(std::floor(at + radius)));
    };
    for (int row = first(robot.y); row <= last(robot.y, shape_.height); ++row) {
        for (int column = first(robot.x); column <= last(robot.x, shape_.width); ++column) {
            if (norm(Vec2{column + 0.5, row + 0.5} - robot) > radius) continue;
            log_odds[static_cast<std::size_t>(row) * shape_.width + column] = scanner.evidence.free();
        }
    }
}

} // namespace adrl
