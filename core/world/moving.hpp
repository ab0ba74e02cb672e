// Where all that moves about a robot is: the world's discs, and people as they walk now.
#pragma once

#include "world/orca.hpp"
#include "world/world.hpp"

namespace adrl {

// Discs at one instant, on the stack. Room for two legs of each person.
struct DiscPlaces {
    static constexpr int kMost = 2 * kMaxDiscs;
    alignas(64) double x[kMost];
    alignas(64) double y[kMost];
    alignas(64) double radius[kMost];
    int count = 0;
    void add(Vec2 p, double r) {
        x[count] = p.x;
        y[count] = p.y;
        radius[count++] = r;
    }
    void pad(); // to whole blocks of kLanes
};

class Moving {
  public:
    // people: the crowd as it is at now_s, to walk on as it does then; both null where nobody walks.
    Moving(const World &world, const Crowd *crowd, const Person *people, double now_s)
        : world_(&world), crowd_(crowd), people_(people), now_s_(now_s) {}
    // The world's discs alone.
    explicit Moving(const World &world) : Moving(world, nullptr, nullptr, 0.0) {}

    const World &world() const { return *world_; }
    // What a robot hits, and a planner foresees.
    DiscPlaces at(double time_s) const;
    // What a LiDAR sees: of people with legs the legs.
    DiscPlaces seen_at(double time_s) const;
    double max_speed() const;
    // Each with its velocity, told add(mover).
    template <class Add>
    void each(double time_s, const Add &add) const {
        for (const MovingDisc &disc : world_->discs()) add(Mover{disc.at(time_s), disc.velocity(time_s), disc.radius});
        for (int k = 0; crowd_ != nullptr && k < crowd_->count(); ++k) {
            const Vec2 velocity{people_[k].vx, people_[k].vy};
            add(Mover{Vec2{people_[k].x, people_[k].y} + (time_s - now_s_) * velocity, velocity,
                      crowd_->walkers[k].radius});
        }
    }

  private:
    template <class Add>
    void each_person(double time_s, const Add &add) const;
    DiscPlaces discs_at(double time_s) const;

    const World *world_;
    const Crowd *crowd_;
    const Person *people_;
    double now_s_;
};

} // namespace adrl
