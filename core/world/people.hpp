// People who walk to and fro along routes: they keep off walls, each other, moving discs and, by their share, the robot
// (avoidance.hpp). Whoever stands lets others go round; the blind avoid nothing. Between two decisions velocities stay.
#pragma once

#include <cstdint>

#include "world/avoidance.hpp"

namespace adrl {

inline constexpr double kPeopleHorizon = 3.0; // seconds for which they avoid each other,
inline constexpr double kWallHorizon = 1.0;   // and walls
inline constexpr double kSpace = 0.05;        // metres that they leave about themselves,
inline constexpr double kRobotSpace = 0.15;   // and about a robot, which may turn
inline constexpr double kHurry = 1.25;        // greatest over preferred speed

// Everyone at the start of the route, walking. seed: of when they decide first.
void begin_walk(const Crowd &crowd, std::uint64_t seed, Person *people);

// Velocities of those whose decision is due at time_s, among walls that are laid. step_s: until the next call.
void decide(const World &world, const Crowd &crowd, const Mover &robot, double time_s, double step_s, Person *people);

// step_s on at these velocities.
void walk(const Crowd &crowd, double step_s, Person *people);

} // namespace adrl
