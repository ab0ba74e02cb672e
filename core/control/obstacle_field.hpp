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

    // Distances up to `most`, out to `half_side` along each axis; beyond that all is free. Allocates where it must
    // grow.
    void fill(const NearObstacles &obstacles, double heading, double half_side, double most);

    // Distances from count points (x, y) in the robot's frame.
    void look_up(const float *x, const float *y, int count, float *out) const;

  private:
    std::vector<float> nodes_;
    int side_ = 0;
    float half_ = 0.0F;
};

} // namespace adrl
