// Counter-based random numbers: a value depends on (key, counter) alone, never on the order of calls or the thread.
#pragma once

#include <cstdint>

#include "clones.hpp"

namespace adrl {

// The finaliser of SplitMix64 (Steele, Lea, Flood 2014): a bijection of 64 bits that passes as random.
ADRL_INLINE std::uint64_t mix64(std::uint64_t x) {
    x += 0x9E3779B97F4A7C15ULL;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
    return x ^ (x >> 31);
}

ADRL_INLINE std::uint64_t random_key(std::uint64_t seed, std::uint64_t step) { return mix64(seed ^ mix64(step)); }

// Nearly normal, zero mean and unit variance: the sum of four 16-bit uniforms (Irwin-Hall), bounded by +-3.47.
// Cheap enough for one number a beam, and a real range sensor has no infinite tails either.
ADRL_INLINE double nearly_normal(std::uint64_t bits) {
    const auto sum = static_cast<double>(
        static_cast<std::int32_t>((bits & 0xFFFF) + ((bits >> 16) & 0xFFFF) + ((bits >> 32) & 0xFFFF) + (bits >> 48)));
    constexpr double mean = 2.0 * 65535.0;
    constexpr double inverse_std = 1.0 / 37837.22; // sqrt(4 (65536^2 - 1) / 12)
    return (sum - mean) * inverse_std;
}

// Uniform in [0, 1).
ADRL_INLINE double uniform01(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1.0p-53; }

} // namespace adrl
