// A footprint from what Python gives: a radius, and corners when it is a polygon.
#pragma once

#include "arrays.hpp"
#include "drive/collision.hpp"

inline adrl::Footprint make_footprint(double radius, const In<double, Rows2> &corners) {
    require_finite({radius}, "radius_m");
    require_all_finite(corners, "footprint");
    adrl::Footprint footprint{radius, {}};
    if (corners.shape(0) > adrl::kMaxCorners) throw nb::value_error("a footprint has at most 16 corners");
    for (std::size_t i = 0; i < corners.shape(0); ++i) footprint.corners.push_back({corners(i, 0), corners(i, 1)});
    if (!footprint.is_disc()) {
        footprint.radius = 0.0;
        for (const adrl::Vec2 &c : footprint.corners) footprint.radius = std::max(footprint.radius, norm(c));
    }
    return footprint;
}
