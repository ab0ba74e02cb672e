// Distances to obstacles on a lattice about the robot, for controllers that ask for very many.
#pragma once

#include <vector>

#include "control/near_obstacles.hpp"

namespace adrl {

// Nodes every kSpacing metres in the robot's frame, interpolated between: exact on straight walls, too far by at most
// half a spacing at an end or corner. Standing obstacles only.
class ObstacleField {
  public:
    static constexpr float kSpacing = 0.05F;

    void reserve(double half_side) { nodes_.reserve(side_of(half_side) * side_of(half_side)); }
    // Distances up to `most`, out to `half_side` along each axis; beyond that all is free. Allocates nothing for as
    // much as is reserved.
    void fill(const NearObstacles &obstacles, double heading, double half_side, double most);

    // Distances from count points (x, y) in the robot's frame.
    void look_up(const float *x, const float *y, int count, float *out) const;

  private:
    static std::size_t side_of(double half_side) {
        return 2 * static_cast<std::size_t>(std::ceil(half_side / kSpacing)) + 1;
    }
    std::vector<float> nodes_;
    int side_ = 0;
    float half_ = 0.0F;
};

} // namespace adrl
