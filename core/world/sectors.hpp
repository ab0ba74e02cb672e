// Scans by sectors about the robot: the nearest range of the beams that point into each.
#pragma once

#include <cstdint>
#include <vector>

namespace adrl {

// Which beams of one LiDAR point into which sector; a beam may be in two, a sector may have none.
struct SectorTable {
    std::vector<std::int32_t> beams; // those of the first sector, then those of the next
    std::vector<std::int32_t> first; // (S + 1) where each sector's begin in `beams`, and the end
    int num_beams = 0;
    float max_range = 6.0F; // what a sector without beams reads
};

// ranges (num_beams) -> out (S). A range that is not a number makes its sectors that.
inline void nearest_of_sectors(const SectorTable &table, const float *ranges, float *out) {
    const std::int32_t *beam = table.beams.data();
    for (std::size_t s = 0; s + 1 < table.first.size(); ++s) {
        const std::int32_t *end = table.beams.data() + table.first[s + 1];
        if (beam == end) {
            out[s] = table.max_range;
            continue;
        }
        float nearest = ranges[*beam];
        for (++beam; beam < end; ++beam) {
            const float range = ranges[*beam];
            nearest = nearest <= range || nearest != nearest ? nearest : range;
        }
        out[s] = nearest;
    }
}

} // namespace adrl
