#include "control/mppi_footprint.hpp"

#include <algorithm>
#include <cmath>

namespace adrl {
namespace {

using Lanes = MppiFootprint::Lanes;

ADRL_CLONES void place_ball(Lanes &n, int count, const Ball &ball) {
    const float bx = ball.x, by = ball.y;
    for (int i = 0; i < count; ++i) {
        n.ball_x[i] = n.x[i] + n.hx[i] * bx - n.hy[i] * by;
        n.ball_y[i] = n.y[i] + n.hy[i] * bx + n.hx[i] * by;
    }
}

ADRL_CLONES void lower_by_ball(Lanes &n, int count, float radius) {
    for (int i = 0; i < count; ++i) {
        const float d = n.distance[i] - radius;
        n.clear[i] = d < n.clear[i] ? d : n.clear[i];
    }
}

ADRL_CLONES void lower_by_ball_and_disc(Lanes &n, int count, float x, float y, float radius) {
    for (int i = 0; i < count; ++i) {
        const float dx = n.ball_x[i] - x;
        const float dy = n.ball_y[i] - y;
        const float d = std::sqrt(dx * dx + dy * dy) - radius;
        n.clear[i] = d < n.clear[i] ? d : n.clear[i];
    }
}

} // namespace

MppiFootprint::MppiFootprint(const Footprint &footprint, double margin) : balls_(footprint_balls(footprint, margin)) {
    for (const Ball &ball : balls_) inscribed_ = std::max(inscribed_, ball.radius);
}

void MppiFootprint::add(int sample, float x, float y, float hx, float hy) {
    const int i = lanes_.count++;
    lanes_.sample[i] = sample;
    lanes_.x[i] = x;
    lanes_.y[i] = y;
    lanes_.hx[i] = hx;
    lanes_.hy[i] = hy;
}

void MppiFootprint::measure(const ObstacleField &field, const SeenDiscs &discs, float most, float *clear) {
    const int count = lanes_.count;
    if (count == 0) return;
    std::fill_n(lanes_.clear, count, most);
    for (const Ball &ball : balls_) {
        place_ball(lanes_, count, ball);
        field.look_up(lanes_.ball_x, lanes_.ball_y, count, lanes_.distance);
        lower_by_ball(lanes_, count, ball.radius);
        for (int k = 0; k < discs.count; ++k)
            lower_by_ball_and_disc(lanes_, count, discs.x[k], discs.y[k], discs.radius[k] + ball.radius);
    }
    for (int i = 0; i < count; ++i) clear[lanes_.sample[i]] = lanes_.clear[i];
}

} // namespace adrl
