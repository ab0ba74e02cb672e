#include "world/moving.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace adrl {
namespace {

constexpr double kLegRadius = 0.1;
constexpr double kStride = 1.4; // metres in which each leg goes forth and back once

} // namespace

void DiscPlaces::pad() {
    for (int i = count; i % kLanes != 0; ++i) {
        x[i] = kFarAway;
        y[i] = kFarAway;
        radius[i] = 0.0;
    }
}

DiscPlaces Moving::discs_at(double time_s) const {
    DiscPlaces out;
    for (const MovingDisc &disc : world_->discs()) out.add(disc.at(time_s), disc.radius);
    return out;
}

template <class Add>
void Moving::each_person(double time_s, const Add &add) const {
    if (crowd_ == nullptr) return;
    const double after_s = time_s - now_s_;
    for (int k = 0; k < crowd_->count(); ++k) {
        const Person &person = people_[k];
        const Vec2 velocity{person.vx, person.vy};
        add(Vec2{person.x, person.y} + after_s * velocity, crowd_->walkers[k].radius, person,
            person.walked + after_s * norm(velocity));
    }
}

DiscPlaces Moving::at(double time_s) const {
    DiscPlaces out = discs_at(time_s);
    each_person(time_s, [&](Vec2 p, double radius, const Person &, double) { out.add(p, radius); });
    out.pad();
    return out;
}

DiscPlaces Moving::seen_at(double time_s) const {
    if (crowd_ == nullptr || !crowd_->legs) return at(time_s);
    DiscPlaces out = discs_at(time_s);
    each_person(time_s, [&](Vec2 p, double radius, const Person &person, double walked) {
        // Legs stay within the body: a stance of 0.6 and a swing of 0.8 of what is beside a leg in it.
        const double room = radius - kLegRadius;
        const double swing = 0.8 * room * std::sin(2.0 * std::numbers::pi * walked / kStride);
        const Vec2 ahead{std::cos(person.heading), std::sin(person.heading)}, left{-ahead.y, ahead.x};
        out.add(p + 0.6 * room * left + swing * ahead, kLegRadius);
        out.add(p - 0.6 * room * left - swing * ahead, kLegRadius);
    });
    out.pad();
    return out;
}

double Moving::max_speed() const {
    double fastest = world_->max_disc_speed();
    if (crowd_ == nullptr) return fastest;
    for (int k = 0; k < crowd_->count(); ++k) {
        fastest = std::max(fastest, norm({people_[k].vx, people_[k].vy}));
    }
    return fastest;
}

} // namespace adrl
