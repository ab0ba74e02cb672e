#include "world/orca.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace adrl {
namespace {

constexpr double kParallel = 1e-5; // sine of the angle between lines that count as parallel
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Vec2 left_of(Vec2 v) { return {-v.y, v.x}; }
Vec2 right_of(Vec2 v) { return {v.y, -v.x}; }
Vec2 unit(Vec2 v) { return (1.0 / norm(v)) * v; }
double squared(Vec2 v) { return dot(v, v); }

// Direction of the tangent from the origin that leaves the disc about p on its right (side 1) or left (side -1).
Vec2 tangent(Vec2 p, double radius, double side) {
    const double d2 = squared(p);
    const double leg = std::sqrt(std::max(0.0, d2 - radius * radius));
    return (1.0 / d2) * Vec2{p.x * leg - side * p.y * radius, side * p.x * radius + p.y * leg};
}

// The point on line `i` nearest to `wanted`, or farthest along it, that the speed and the lines before allow.
std::optional<Vec2> on_line(std::span<const HalfPlane> planes, int i, double max_speed, Vec2 wanted, bool farthest) {
    const HalfPlane &line = planes[i];
    const double middle = dot(line.point, line.direction);
    const double under = middle * middle + max_speed * max_speed - squared(line.point);
    if (under < 0.0) return std::nullopt;
    double from = -middle - std::sqrt(under), to = -middle + std::sqrt(under);
    for (int j = 0; j < i; ++j) {
        const double across = cross(line.direction, planes[j].direction);
        const double ahead = cross(planes[j].direction, line.point - planes[j].point);
        if (std::abs(across) <= kParallel) {
            if (ahead < 0.0) return std::nullopt;
            continue;
        }
        if (across >= 0.0) {
            to = std::min(to, ahead / across);
        } else {
            from = std::max(from, ahead / across);
        }
        if (from > to) return std::nullopt;
    }
    double t = 0.0;
    if (farthest) {
        t = dot(wanted, line.direction) > 0.0 ? to : from;
    } else {
        t = std::clamp(dot(line.direction, wanted - line.point), from, to);
    }
    return line.point + t * line.direction;
}

// Into `best`: the wanted velocity, moved into one half-plane after the other. The first that leaves none, or how many
// there are. farthest: as far as possible in the direction `wanted`, of length 1.
int in_all(std::span<const HalfPlane> planes, double max_speed, Vec2 wanted, bool farthest, Vec2 &best) {
    if (farthest) {
        best = max_speed * wanted;
    } else {
        best = squared(wanted) > max_speed * max_speed ? max_speed * unit(wanted) : wanted;
    }
    for (int i = 0; i < static_cast<int>(planes.size()); ++i) {
        if (planes[i].excess(best) <= 0.0) continue;
        const std::optional<Vec2> found = on_line(planes, i, max_speed, wanted, farthest);
        if (!found) return i;
        best = *found;
    }
    return static_cast<int>(planes.size());
}

// Velocities that violate half-plane i less than j: a half-plane too. None where they are violated alike.
std::optional<HalfPlane> rather(const HalfPlane &i, const HalfPlane &j) {
    const double across = cross(i.direction, j.direction);
    HalfPlane out;
    if (std::abs(across) > kParallel) {
        out.point = i.point + (cross(j.direction, i.point - j.point) / across) * i.direction;
    } else if (dot(i.direction, j.direction) > 0.0) {
        return std::nullopt;
    } else {
        out.point = 0.5 * (i.point + j.point);
    }
    out.direction = unit(j.direction - i.direction);
    return out;
}

// From `best`, which violates half-plane `first`: the velocity whose greatest violation is least.
void least_violating(std::span<const HalfPlane> planes, int hard, int first, double max_speed, Vec2 &best) {
    HalfPlane lifted[kMostHalfPlanes];
    std::copy(planes.begin(), planes.begin() + hard, lifted);
    double violation = 0.0;
    for (int i = first; i < static_cast<int>(planes.size()); ++i) {
        if (planes[i].excess(best) <= violation) continue;
        int count = hard;
        for (int j = hard; j < i; ++j) {
            if (const auto plane = rather(planes[i], planes[j])) lifted[count++] = *plane;
        }
        Vec2 found;
        const int met =
            in_all({lifted, static_cast<std::size_t>(count)}, max_speed, left_of(planes[i].direction), true, found);
        if (met == count) best = found; // otherwise rounding: the best stays
        violation = planes[i].excess(best);
    }
}

} // namespace

HalfPlane avoid_mover(const Mover &self, const Mover &other, double share, double horizon_s, double step_s) {
    const Vec2 apart = other.at - self.at;
    const Vec2 relative = self.velocity - other.velocity;
    const double radius = self.radius + other.radius;
    const bool touching = squared(apart) <= radius * radius;
    // The velocity obstacle is a cone cut off by a disc; touching, it is the disc that the next step must leave.
    const double inverse = 1.0 / (touching ? step_s : horizon_s);
    const Vec2 from_disc = relative - inverse * apart;
    const double along = dot(from_disc, apart);
    HalfPlane out;
    Vec2 change; // the least change of the relative velocity to the cone's border
    if (touching || (along < 0.0 && along * along > radius * radius * squared(from_disc))) {
        const double length = norm(from_disc);
        const Vec2 normal = length > 0.0 ? (1.0 / length) * from_disc : Vec2{-1.0, 0.0};
        out.direction = right_of(normal);
        change = (radius * inverse - length) * normal;
    } else {
        const bool left = cross(apart, from_disc) > 0.0;
        const Vec2 leg = tangent(apart, radius, left ? 1.0 : -1.0);
        out.direction = left ? leg : -1.0 * leg;
        change = dot(relative, out.direction) * out.direction - relative;
    }
    out.point = self.velocity + share * change;
    return out;
}

bool avoid_wall(const Mover &self, const Walls &walls, int index, double horizon_s, std::span<const HalfPlane> before,
                HalfPlane &out) {
    const WallEdge &edge = walls[index];
    const WallEdge &next = walls[edge.after];
    const double inverse = 1.0 / horizon_s;
    const Vec2 a = edge.a - self.at, b = edge.b - self.at, along = edge.direction();
    const double radius = self.radius;
    for (const HalfPlane &nearer : before) {
        const auto covers = [&](Vec2 end) { return nearer.excess(inverse * end) >= inverse * radius - 1e-5; };
        if (covers(a) && covers(b)) return false;
    }
    const double s = -dot(a, along) / norm(b - a); // the nearest point of the line, in parts of the edge
    const double off2 = squared(a - dot(a, along) * along);
    const auto touch = [&](Vec2 direction) {
        out = {{0.0, 0.0}, direction};
        return true;
    };
    if (s < 0.0 && squared(a) <= radius * radius) return edge.convex && touch(unit(left_of(a)));
    if (s > 1.0 && squared(b) <= radius * radius) {
        // Of a corner that two edges share, only the one does that faces the person.
        return next.convex && cross(b, next.direction()) >= 0.0 && touch(unit(left_of(b)));
    }
    if (s >= 0.0 && s <= 1.0 && off2 <= radius * radius) return touch(-1.0 * along);

    // Seen so obliquely that one corner alone makes the obstacle, or both ends.
    const bool from_a = s < 0.0 && off2 <= radius * radius, from_b = s > 1.0 && off2 <= radius * radius;
    if ((from_a && !edge.convex) || (from_b && !next.convex)) return false;
    const Vec2 left_end = from_b ? b : a, right_end = from_a ? a : b;
    const WallEdge &left_edge = from_b ? next : edge;  // begins in the left end
    const WallEdge &right_edge = from_a ? edge : next; // begins in the right end
    const bool corner = from_a || from_b;
    Vec2 left = left_edge.convex ? tangent(left_end, radius, 1.0) : -1.0 * along;
    Vec2 right = right_edge.convex ? tangent(right_end, radius, -1.0) : along;
    // A leg must not run into the next wall: that wall's own half-plane holds there.
    const Vec2 back = -1.0 * walls[left_edge.before].direction(), on = right_edge.direction();
    const bool foreign_left = left_edge.convex && cross(left, back) >= 0.0;
    const bool foreign_right = right_edge.convex && cross(right, on) <= 0.0;
    if (foreign_left) left = back;
    if (foreign_right) right = on;

    const Vec2 from = inverse * left_end, to = inverse * right_end, cut = to - from;
    const Vec2 velocity = self.velocity;
    const double t = corner ? 0.5 : dot(velocity - from, cut) / squared(cut);
    const double t_left = dot(velocity - from, left), t_right = dot(velocity - to, right);
    const auto round = [&](Vec2 centre) {
        const Vec2 away = unit(velocity - centre);
        out = {centre + (radius * inverse) * away, right_of(away)};
        return true;
    };
    if ((t < 0.0 && t_left < 0.0) || (corner && t_left < 0.0 && t_right < 0.0)) return round(from);
    if (t > 1.0 && t_right < 0.0) return round(to);
    const auto straight = [&](Vec2 point, Vec2 direction) {
        out = {point + (radius * inverse) * left_of(direction), direction};
        return true;
    };
    const double to_cut = t < 0.0 || t > 1.0 || corner ? kInfinity : squared(velocity - (from + t * cut));
    const double to_left = t_left < 0.0 ? kInfinity : squared(velocity - (from + t_left * left));
    const double to_right = t_right < 0.0 ? kInfinity : squared(velocity - (to + t_right * right));
    if (to_cut <= to_left && to_cut <= to_right) return straight(from, -1.0 * along);
    if (to_left <= to_right) return !foreign_left && straight(from, left);
    return !foreign_right && straight(to, -1.0 * right);
}

Vec2 nearest_allowed(std::span<const HalfPlane> planes, int hard, double max_speed, Vec2 preferred) {
    Vec2 best;
    const int met = in_all(planes, max_speed, preferred, false, best);
    if (met < static_cast<int>(planes.size())) least_violating(planes, hard, met, max_speed, best);
    return best;
}

} // namespace adrl
