// A world's static geometry on a grid, for planners.
#pragma once

#include "world/world.hpp"

namespace adrl {

struct GridFrame {
    double origin_x = 0.0; // lower left corner of cell (0, 0)
    double origin_y = 0.0;
    int width = 0;
    int height = 0;
    double resolution = 0.05;
};

// out (height x width): distance in metres from each cell's centre to the nearest static obstacle, at most `limit`;
// 0 inside obstacles.
void clearance_field(const World &world, const GridFrame &frame, double limit, float *out);

} // namespace adrl
