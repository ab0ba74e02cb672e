#include "planning/path_guide.hpp"

#include "drive/collision.hpp"

namespace adrl {

Guided follow_path(const World &world, const Path &path, const GuideRules &rules, Vec2 p, double along) {
    Guided guided;
    guided.along = path.project(p, along, along + rules.window);
    guided.left = path.length() - guided.along + norm(path.at(guided.along) - p);
    guided.waypoint = rules.lookahead > 0.0
                          ? visible_waypoint(world, path, rules.corridor, p, guided.along, rules.lookahead)
                          : path.at(path.length());
    return guided;
}

Vec2 visible_waypoint(const World &world, const Path &path, double corridor, Vec2 from, double along,
                      double lookahead) {
    for (const double part : {1.0, 0.75, 0.55, 0.4, 0.3, 0.2}) {
        const Vec2 target = path.at(along + part * lookahead);
        if (corridor_free(world, from, target, corridor)) return target;
    }
    return path.at(along + 0.15 * lookahead);
}

} // namespace adrl
