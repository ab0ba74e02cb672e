#include "drive/footprint_balls.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {
namespace {

constexpr int kCandidates = 32; // centres that are tried, along each side of the footprint's box

// Distance from a point inside to the rim; negative outside.
double depth(const std::vector<Vec2> &corners, Vec2 p) {
    double least = kFarAway;
    for (std::size_t k = 0; k < corners.size(); ++k) {
        const Vec2 e = corners[(k + 1) % corners.size()] - corners[k];
        least = std::min(least, cross(e, p - corners[k]) / norm(e));
    }
    return least;
}

struct Candidate {
    Vec2 centre;
    double radius;
};

} // namespace

std::vector<Ball> footprint_balls(const Footprint &footprint, double margin) {
    if (footprint.is_disc()) return {{0.0F, 0.0F, static_cast<float>(footprint.radius)}};
    const std::vector<Vec2> &corners = footprint.corners;
    std::vector<Candidate> candidates;
    std::vector<Vec2> rim; // what no ball has come near to yet
    Vec2 low = corners[0], high = corners[0];
    for (std::size_t k = 0; k < corners.size(); ++k) {
        const Vec2 a = corners[k], e = corners[(k + 1) % corners.size()] - a;
        low = {std::min(low.x, a.x), std::min(low.y, a.y)};
        high = {std::max(high.x, a.x), std::max(high.y, a.y)};
        const int pieces = std::max(1, static_cast<int>(std::ceil(4.0 * norm(e) / margin)));
        for (int p = 0; p < pieces; ++p) rim.push_back(a + (1.0 * p / pieces) * e);
    }
    for (const Vec2 &p : rim) candidates.push_back({p, 0.0});
    for (int i = 0; i <= kCandidates; ++i) {
        for (int j = 0; j <= kCandidates; ++j) {
            const Vec2 p{low.x + (high.x - low.x) * i / kCandidates, low.y + (high.y - low.y) * j / kCandidates};
            const double radius = depth(corners, p);
            if (radius > 0.0) candidates.push_back({p, radius});
        }
    }
    std::vector<Ball> balls;
    while (!rim.empty()) {
        const auto near = [&](const Candidate &c, Vec2 p) { return norm(p - c.centre) - c.radius <= margin; };
        const auto covered = [&](const Candidate &c) {
            return std::count_if(rim.begin(), rim.end(), [&](Vec2 p) { return near(c, p); });
        };
        const Candidate *best = &candidates[0];
        std::ptrdiff_t most = 0;
        for (const Candidate &c : candidates) {
            const std::ptrdiff_t count = covered(c);
            if (count < most || (count == most && c.radius <= best->radius)) continue;
            most = count;
            best = &c;
        }
        balls.push_back(
            {static_cast<float>(best->centre.x), static_cast<float>(best->centre.y), static_cast<float>(best->radius)});
        rim.erase(std::remove_if(rim.begin(), rim.end(), [&](Vec2 p) { return near(*best, p); }), rim.end());
    }
    return balls;
}

} // namespace adrl
