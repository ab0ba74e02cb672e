#include "planning/path_guide.hpp"

#include "drive/collision.hpp"

namespace adrl {
namespace {

constexpr double kAtCusp = 0.05; // metres along the path: a controller may never come to the very place

} // namespace

double led_to(const Path &path, double along, bool car) { return car ? path.next_cusp(along) : path.length(); }

double come_along(const Path &path, Vec2 p, double along, double window, bool car) {
    if (!car) return path.project(p, along, along + window);
    const double cusp = path.next_cusp(along);
    const double come = path.project(p, along, std::min(along + window, cusp));
    return cusp - come < kAtCusp ? cusp : come;
}

void path_ahead(const Path &path, double along, double *out) {
    for (const double metres : kPathAhead) {
        const Vec2 point = path.at(along + metres);
        *out++ = point.x;
        *out++ = point.y;
    }
}

Guided follow_path(const World &world, const Path &path, const GuideRules &rules, Vec2 p, double along) {
    Guided guided;
    guided.along = come_along(path, p, along, rules.window, rules.car);
    guided.left = path.length() - guided.along + norm(path.at(guided.along) - p);
    const auto is_free = [&](Vec2 target) { return corridor_free(world, p, target, rules.corridor); };
    const double stop = led_to(path, guided.along, rules.car);
    guided.waypoint = rules.lookahead > 0.0 ? visible_waypoint(path, guided.along, stop, rules.lookahead, is_free)
                                            : path.at(path.length());
    return guided;
}

} // namespace adrl
