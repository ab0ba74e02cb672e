// What a local controller knows of the obstacles about its robot, whether they come from the true world or from a map
// of the robot's own.
#pragma once

#include <optional>

#include "drive/collision.hpp"
#include "planning/occupancy.hpp"
#include "world/moving.hpp"

namespace adrl {

// Capsules: all points within `radius` of the segment from a to a + e. Circles have e = 0, walls radius 0, and solid
// cells stand as the segments of their outlines: so distances to them are exact. Metres relative to the robot's
// position, axes of the world, in single precision.
class NearObstacles {
  public:
    static constexpr int kMax = 1024; // where there are more, the robot looks less far

    // What of the world lies within `reach`. foresee: what moves is where it will be; otherwise it stands still.
    void gather(const Moving &moving, const Pose &pose, double reach, double time_s, bool foresee);
    // Solid cells of a window within `reach`.
    void gather(const std::int8_t *log_odds, const WindowShape &shape, const WindowOrigin &origin, const Pose &pose,
                double reach);

    int count() const { return count_; }
    // Puts what moves where it will be after `after_s`, behind the others: the number of all.
    int place_discs(double after_s);
    // Distance from the footprint's edge to the nearest obstacle after `after_s`, at most `limit`; 0 or less where they
    // overlap. at: relative to the robot's position.
    double clearance(const Footprint &footprint, const Pose &at, double limit, double after_s);
    // Whether a disc can slide from `from` to `to`, both relative to the robot, without touching what stands still.
    bool corridor_free(Vec2 from, Vec2 to, double radius) const;

    alignas(64) float ax[kMax], ay[kMax], ex[kMax], ey[kMax];
    alignas(64) float inverse[kMax]; // 1 / |e|^2
    alignas(64) float radius[kMax];

  private:
    bool add(Vec2 a, Vec2 b, double r);
    bool gather_within(const World &world, double reach);
    template <class Solid>
    bool outline(const Solid &solid, const Pose &lattice, double cell, double reach);

    Vec2 robot_;
    int count_ = 0;
    std::optional<Moving> moving_;
    double time_s_ = 0.0;
};

} // namespace adrl
