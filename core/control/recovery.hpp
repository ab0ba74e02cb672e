// What a robot does that is stuck, in place of Nav2's recovery behaviours (spin, back up, drive on heading).
#pragma once

#include "control/controller.hpp"

namespace adrl {

// Numbers it remembers of a robot: where it was last seen to get on, for how long it has not, and for how long it still
// has to get out.
inline constexpr int kRecoveryMemory = 4;

// The controller's command; or, for a robot that has not got kProgress away from a place within kPatience, for
// kEscape seconds the one of some slow arcs, forward, backward or, but for a car, in place, that leads where it has
// most room: it moves, whatever room it has where it stands.
Twist recover(const Situation &now, const Twist &chosen, double *memory);

} // namespace adrl
