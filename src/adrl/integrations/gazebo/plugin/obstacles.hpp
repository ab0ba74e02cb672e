// What stands around a robot, and where: boxes, cylinders, and discs that move.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include <gazebo/physics/physics.hh>

namespace adrl {

constexpr double kHeight = 1.0;    // of all obstacles
constexpr double kCellar = -100.0; // where things stand that no world needs at the moment

struct Disc {
    gazebo::physics::ModelPtr model;
    std::array<double, 8> row;
};

inline gazebo::physics::CylinderShapePtr cylinder_of(const gazebo::physics::CollisionPtr &body) {
    return boost::dynamic_pointer_cast<gazebo::physics::CylinderShape>(body->GetShape());
}

inline void stand_box(const gazebo::physics::CollisionPtr &body, const std::array<double, 5> &row) {
    boost::dynamic_pointer_cast<gazebo::physics::BoxShape>(body->GetShape())->SetSize({row[3], row[4], kHeight});
    body->SetWorldPose({row[0], row[1], 0.5 * kHeight, 0.0, 0.0, row[2]});
}

inline void stand_cylinder(const gazebo::physics::CollisionPtr &body, const std::array<double, 3> &row) {
    cylinder_of(body)->SetSize(row[2], kHeight);
    body->SetWorldPose({row[0], row[1], 0.5 * kHeight, 0.0, 0.0, 0.0});
}

inline void store(const gazebo::physics::CollisionPtr &body) { body->SetWorldPose({0.0, 0.0, kCellar, 0.0, 0.0, 0.0}); }

// Where a disc is: to and fro between its ends, standing still after stop_s.
inline void place(const Disc &disc, double time_s) {
    const auto [x1, y1, x2, y2, radius, speed, phase, stop_s] = disc.row;
    (void)radius;
    const double run = std::max(2.0 * std::hypot(x2 - x1, y2 - y1), 1e-9);
    const double round = phase + speed * std::min(time_s, stop_s) / run;
    const double share = 1.0 - std::abs(1.0 - 2.0 * (round - std::floor(round)));
    disc.model->SetWorldPose({x1 + share * (x2 - x1), y1 + share * (y2 - y1), 0.0, 0.0, 0.0, 0.0});
}

} // namespace adrl
