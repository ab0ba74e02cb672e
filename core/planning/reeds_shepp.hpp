// Shortest curves of a car that drives both ways between two poses, nothing in its way (Reeds, Shepp 1990).
#pragma once

#include "world/geometry.hpp"

namespace adrl {

struct CarPiece {
    double length = 0.0; // metres; below 0 backward
    int turn = 0;        // 1 to the left, -1 to the right, both on the tightest curve; 0 straight
};

// Up to five arcs and straight lines, driven one after the other.
struct CarCurve {
    CarPiece pieces[5];
    int count = 0;
};

// What a curve costs besides its length: metres a metre driven backward, and metres a change of direction.
struct GearCosts {
    double backward = 0.0;
    double cusp = 0.0;
};

inline constexpr int kEitherGear = 0; // before the first piece: no direction yet

double length_of(const CarCurve &curve);
// Metres with the costs of gears; gear: of the motion before, 1 forward, -1 backward.
double cost_of(const CarCurve &curve, const GearCosts &costs, int gear);
// The pose after so many metres of a piece that begins at `from`; below 0 backward.
Pose drive_piece(const Pose &from, const CarPiece &piece, double length, double radius);

// The curve of least cost among those of the 48 words of Reeds and Shepp that lead from one pose to the other. Without
// costs of gears it is the shortest of all. backward: whether the car can; where it cannot there may be none, count 0.
CarCurve reeds_shepp(const Pose &from, const Pose &to, double radius, const GearCosts &costs = {},
                     int gear = kEitherGear, bool backward = true);

} // namespace adrl
