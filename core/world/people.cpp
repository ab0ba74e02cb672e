#include "world/people.hpp"

#include <algorithm>
#include <cmath>

#include "random.hpp"

namespace adrl {
namespace {

constexpr double kArrived = 0.5;  // metres from a way point at which the next is headed for
constexpr double kPassed = 1.5;   // or passed within so much
constexpr double kPatience = 4.0; // seconds after which one who is held up turns round
constexpr double kHeldUp = 0.2;   // of the preferred speed, or slower
constexpr double kTurning = 0.05; // m/s at which a person's feet turn to where it goes

Vec2 place(const Person &person) { return {person.x, person.y}; }
Vec2 velocity(const Person &person) { return {person.vx, person.vy}; }

Vec2 way_point(const Crowd &crowd, const Walker &walker, double index) {
    return crowd.way_points[walker.first + static_cast<int>(index)];
}

Vec2 preferred(const Crowd &crowd, int k, const Person *people) {
    const Walker &walker = crowd.walkers[k];
    const Vec2 here = place(people[k]);
    const Vec2 ahead = way_point(crowd, walker, people[k].goal) - here;
    const double far = norm(ahead);
    Vec2 wanted = far > 0.0 ? (walker.speed / far) * ahead : Vec2{};
    if (walker.group < 0) return wanted;
    // Who has strayed from the middle of a group is drawn to it, up to as much as to the goal.
    Vec2 sum;
    int members = 0;
    for (int j = 0; j < crowd.count(); ++j) {
        if (crowd.walkers[j].group != walker.group) continue;
        sum = sum + place(people[j]);
        ++members;
    }
    const Vec2 inward = (1.0 / members) * sum - here;
    const double strayed = norm(inward) - 0.25 * members;
    if (strayed > 0.0) wanted = wanted + (walker.speed * std::min(strayed, 1.0) / norm(inward)) * inward;
    const double speed = norm(wanted), most = kHurry * walker.speed;
    return speed > most ? (most / speed) * wanted : wanted;
}

// All that moves, or stands there as a person, near person k. Who stands, and what does not look, avoids nothing
// itself.
Neighbours neighbours(const World &world, const Crowd &crowd, const Mover &robot, double time_s, int k,
                      const Person *people) {
    const Walker &self = crowd.walkers[k];
    Neighbours out(place(people[k]), self.radius);
    for (int j = 0; j < crowd.count(); ++j) {
        const Walker &other = crowd.walkers[j];
        if (j != k)
            out.offer({place(people[j]), velocity(people[j]), other.radius + kSpace},
                      other.speed > 0.0 && !other.blind ? 0.5 : 1.0);
    }
    for (const MovingDisc &disc : world.discs()) out.offer({disc.at(time_s), disc.velocity(time_s), disc.radius}, 1.0);
    if (self.share > 0.0) out.offer({robot.at, robot.velocity, robot.radius + kRobotSpace}, self.share);
    return out;
}

Vec2 decided(const World &world, const Crowd &crowd, const Mover &robot, double time_s, double hold_s, int k,
             const Person *people) {
    const Walker &walker = crowd.walkers[k];
    const Avoiding who{{place(people[k]), velocity(people[k]), walker.radius + kSpace},
                       walker.radius,
                       preferred(crowd, k, people),
                       kHurry * walker.speed,
                       kPeopleHorizon,
                       kWallHorizon,
                       hold_s};
    return velocity_among(world, who, neighbours(world, crowd, robot, time_s, k, people));
}

// Whether a way point is reached, or left behind.
bool passed(const Crowd &crowd, const Walker &walker, const Person &person) {
    const Vec2 target = way_point(crowd, walker, person.goal);
    const Vec2 beyond = place(person) - target;
    const double far = norm(beyond);
    const Vec2 leg = target - way_point(crowd, walker, person.goal - person.onward);
    return far < kArrived || (far < kPassed && dot(beyond, leg) > 0.0);
}

void turn_round(Person &person) {
    person.onward = -person.onward;
    person.goal += person.onward;
    person.held_s = 0.0;
}

// Heads for the next way point where this one is passed. At the route's end the whole group turns.
void head_on(const Crowd &crowd, int k, Person *people) {
    const Walker &walker = crowd.walkers[k];
    Person &person = people[k];
    if (!passed(crowd, walker, person)) return;
    const double next = person.goal + person.onward;
    if (next >= 0.0 && next < walker.last - walker.first) {
        person.goal = next;
        return;
    }
    const double end = person.goal;
    for (int j = 0; j < crowd.count(); ++j) {
        const bool together = walker.group >= 0 && crowd.walkers[j].group == walker.group;
        if (j == k || (together && people[j].goal == end)) turn_round(people[j]);
    }
}

} // namespace

void begin_walk(const Crowd &crowd, std::uint64_t seed, Person *people) {
    for (int k = 0; k < crowd.count(); ++k) {
        const Vec2 start = way_point(crowd, crowd.walkers[k], 0.0);
        people[k] = {};
        people[k].x = start.x;
        people[k].y = start.y;
        people[k].onward = 1.0;
        people[k].goal = crowd.walkers[k].last - crowd.walkers[k].first > 1 ? 1.0 : 0.0;
        people[k].wait_s = crowd.walkers[k].reaction_s * uniform01(mix64(random_key(seed, k)));
    }
    for (int k = 0; k < crowd.count(); ++k) {
        const Vec2 v = preferred(crowd, k, people);
        people[k].vx = v.x;
        people[k].vy = v.y;
        people[k].heading = std::atan2(v.y, v.x);
    }
}

void decide(const World &world, const Crowd &crowd, const Mover &robot, double time_s, double step_s, Person *people) {
    Vec2 chosen[kMaxPeople]; // all decide by what they see before anyone does
    bool due[kMaxPeople];
    for (int k = 0; k < crowd.count(); ++k) {
        due[k] = crowd.walkers[k].speed > 0.0 && people[k].wait_s < 0.5 * step_s;
        if (!due[k]) continue;
        const double hold_s = std::max(crowd.walkers[k].reaction_s, step_s);
        chosen[k] = crowd.walkers[k].blind ? preferred(crowd, k, people)
                                           : decided(world, crowd, robot, time_s, hold_s, k, people);
        people[k].wait_s += hold_s;
    }
    for (int k = 0; k < crowd.count(); ++k) {
        if (!due[k]) continue;
        people[k].vx = chosen[k].x;
        people[k].vy = chosen[k].y;
        if (norm(chosen[k]) > kTurning) people[k].heading = std::atan2(chosen[k].y, chosen[k].x);
    }
}

void walk(const Crowd &crowd, double step_s, Person *people) {
    for (int k = 0; k < crowd.count(); ++k) {
        const Walker &walker = crowd.walkers[k];
        if (!(walker.speed > 0.0)) continue;
        Person &person = people[k];
        const double speed = norm(velocity(person));
        person.x += step_s * person.vx;
        person.y += step_s * person.vy;
        person.walked += step_s * speed;
        person.wait_s -= step_s;
        person.held_s = speed < kHeldUp * walker.speed ? person.held_s + step_s : 0.0;
        head_on(crowd, k, people);
        if (person.held_s > kPatience) turn_round(person);
    }
}

} // namespace adrl
