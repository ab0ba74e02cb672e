#include "planning/path_guide.hpp"

#include "drive/collision.hpp"

namespace adrl {

Guided follow_path(const World &world, const Path &path, const GuideRules &rules, Vec2 p, double along) {
    Guided guided;
    guided.along = path.project(p, along, along + rules.window);
    guided.left = path.length() - guided.along + norm(path.at(guided.along) - p);
    const auto is_free = [&](Vec2 target) { return corridor_free(world, p, target, rules.corridor); };
    guided.waypoint =
        rules.lookahead > 0.0 ? visible_waypoint(path, guided.along, rules.lookahead, is_free) : path.at(path.length());
    return guided;
}

} // namespace adrl
