// Exact Euclidean distance transform of a bitmap.
#pragma once

#include <cstdint>

namespace adrl {

// solid (height x width, row-major) -> distance in cells from each cell's centre to the centre of the nearest solid
// cell; 0 in solid cells, infinity everywhere when there is none. Linear time: column scans, then the lower envelope
// of parabolas along each row (Felzenszwalb and Huttenlocher 2012).
void distance_field(const std::uint8_t *solid, int height, int width, float *out);

// Chebyshev distance in cells to the nearest solid cell, at most 255; 0 in solid cells. Cells beyond the border count
// as solid, so that a jump of this size never leaves the bitmap.
void chebyshev_field(const std::uint8_t *solid, int height, int width, std::uint8_t *out);

} // namespace adrl
