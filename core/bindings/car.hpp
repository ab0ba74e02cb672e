// A robot as planners of cars take it.
#pragma once

#include "arrays.hpp"
#include "planning/car_planner.hpp"
#include "sim/batch_sim.hpp"

inline adrl::Car car_of(const adrl::Robot &robot, double margin) {
    if (!robot.limits.is_car()) throw nb::value_error("the robot turns on the spot: its min_turning_radius_m is 0");
    if (!(margin >= 0.0)) throw nb::value_error("the margin is negative");
    return {robot.footprint, robot.limits.min_turning_radius, robot.limits.min_speed < 0.0, margin};
}
