#include "planning/path.hpp"

#include <algorithm>

namespace adrl {

void Path::reserve(int points) {
    points_.reserve(points);
    along_.reserve(points);
    cusps_.reserve(points);
}

void Path::assign(std::span<const double> points) {
    points_.clear();
    along_.clear();
    cusps_.clear();
    for (std::size_t i = 0; i + 1 < points.size(); i += 2) {
        const Vec2 p{points[i], points[i + 1]};
        along_.push_back(points_.empty() ? 0.0 : along_.back() + norm(p - points_.back()));
        points_.push_back(p);
    }
    for (std::size_t k = 1; k + 1 < points_.size(); ++k) {
        if (dot(points_[k] - points_[k - 1], points_[k + 1] - points_[k]) < 0.0) cusps_.push_back(along_[k]);
    }
}

double Path::next_cusp(double s) const {
    const auto next = std::upper_bound(cusps_.begin(), cusps_.end(), s);
    return next == cusps_.end() ? length() : *next;
}

Vec2 Path::at(double s) const {
    const auto next = std::upper_bound(along_.begin(), along_.end(), s);
    if (next == along_.begin()) return points_.front();
    if (next == along_.end()) return points_.back();
    const auto i = static_cast<std::size_t>(next - along_.begin());
    const double u = (s - along_[i - 1]) / (along_[i] - along_[i - 1]);
    return points_[i - 1] + u * (points_[i] - points_[i - 1]);
}

double Path::project(Vec2 p, double from, double to) const {
    double best = from;
    double least = norm(at(from) - p);
    for (std::size_t i = 1; i < points_.size(); ++i) {
        if (along_[i] < from || along_[i - 1] > to) continue;
        const Vec2 e = points_[i] - points_[i - 1];
        const double length2 = dot(e, e);
        if (length2 <= 0.0) continue;
        const double length = along_[i] - along_[i - 1];
        const double s = std::clamp(along_[i - 1] + length * dot(p - points_[i - 1], e) / length2,
                                    std::max(from, along_[i - 1]), std::min(to, along_[i]));
        const double d = norm(at(s) - p);
        if (d < least) {
            least = d;
            best = s;
        }
    }
    return best;
}

} // namespace adrl
