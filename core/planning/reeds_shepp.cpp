#include "planning/reeds_shepp.hpp"

#include <cmath>
#include <limits>
#include <numbers>

namespace adrl {
namespace {

constexpr double kHalfPi = 0.5 * std::numbers::pi;
constexpr double kNone = 1e-9; // radii: shorter pieces are none
constexpr double kSlack = 1e-9;

struct Polar {
    double r, theta;
};

Polar polar(double x, double y) { return {std::hypot(x, y), std::atan2(y, x)}; }

// A goal in the frame of the start, in turning radii.
struct Target {
    double x, y, phi;
};

// Three lengths of a word, in radii; the others of its pieces follow from them.
struct Lengths {
    double t = 0.0, u = 0.0, v = 0.0;
    bool found = false;
};

Lengths found(double t, double u, double v) { return {t, u, v, true}; }

bool below(double value) { return value < -kSlack; }
bool above(double value) { return value > kSlack; }

// The equations are those of section 8 of the paper, for words that begin forward to the left.

// 8.1, L+ S+ L+.
Lengths left_straight_left(const Target &g) {
    const auto [u, t] = polar(g.x - std::sin(g.phi), g.y - 1.0 + std::cos(g.phi));
    const double v = wrap_angle(g.phi - t);
    if (below(t) || below(v)) return {};
    return found(t, u, v);
}

// 8.2, L+ S+ R+.
Lengths left_straight_right(const Target &g) {
    const auto [d, angle] = polar(g.x + std::sin(g.phi), g.y - 1.0 - std::cos(g.phi));
    if (d < 2.0) return {};
    const double u = std::sqrt(d * d - 4.0);
    const double t = wrap_angle(angle + std::atan2(2.0, u));
    const double v = wrap_angle(t - g.phi);
    if (below(t) || below(v)) return {};
    return found(t, u, v);
}

// 8.3 and 8.4, L+ R- L+ and L+ R- L-.
Lengths left_right_left(const Target &g) {
    const auto [d, angle] = polar(g.x - std::sin(g.phi), g.y - 1.0 + std::cos(g.phi));
    if (d > 4.0) return {};
    const double u = -2.0 * std::asin(0.25 * d);
    const double t = wrap_angle(angle + 0.5 * u + std::numbers::pi);
    const double v = wrap_angle(g.phi - t + u);
    if (below(t)) return {};
    return found(t, u, v);
}

// Of the words of four arcs, from the lengths u and v of the two in the middle: the first and the last.
Lengths outer_arcs(double u, double v, double xi, double eta, const Target &g) {
    const double delta = wrap_angle(u - v);
    const double a = std::sin(u) - std::sin(delta), b = std::cos(u) - std::cos(delta) - 1.0;
    const double angle = std::atan2(eta * a - xi * b, xi * a + eta * b);
    const double side = 2.0 * (std::cos(delta) - std::cos(v) - std::cos(u)) + 3.0;
    const double tau = side < 0.0 ? wrap_angle(angle + std::numbers::pi) : wrap_angle(angle);
    const double omega = wrap_angle(tau - u + v - g.phi);
    return found(tau, u, omega);
}

// 8.7, L+ R+ L- R-, the middle arcs of equal length.
Lengths four_arcs_one_cusp(const Target &g) {
    const double xi = g.x + std::sin(g.phi), eta = g.y - 1.0 - std::cos(g.phi);
    const double rho = 0.25 * (2.0 + std::hypot(xi, eta));
    if (rho > 1.0) return {};
    const double u = std::acos(rho);
    const Lengths arcs = outer_arcs(u, -u, xi, eta, g);
    if (below(arcs.t) || above(arcs.v)) return {};
    return arcs;
}

// 8.8, L+ R- L- R+, likewise.
Lengths four_arcs_two_cusps(const Target &g) {
    const double xi = g.x + std::sin(g.phi), eta = g.y - 1.0 - std::cos(g.phi);
    const double rho = (20.0 - xi * xi - eta * eta) / 16.0;
    if (rho < 0.0 || rho > 1.0) return {};
    const double u = -std::acos(rho);
    if (u < -kHalfPi) return {};
    const Lengths arcs = outer_arcs(u, u, xi, eta, g);
    if (below(arcs.t) || below(arcs.v)) return {};
    return arcs;
}

// 8.9, L+ R- S- L-, the second arc a quarter of a turn.
Lengths quarter_straight_left(const Target &g) {
    const auto [d, angle] = polar(g.x - std::sin(g.phi), g.y - 1.0 + std::cos(g.phi));
    if (d < 2.0) return {};
    const double r = std::sqrt(d * d - 4.0);
    const double u = 2.0 - r;
    const double t = wrap_angle(angle + std::atan2(r, -2.0));
    const double v = wrap_angle(g.phi - kHalfPi - t);
    if (below(t) || above(u) || above(v)) return {};
    return found(t, u, v);
}

// 8.10, L+ R- S- R-, likewise.
Lengths quarter_straight_right(const Target &g) {
    const double xi = g.x + std::sin(g.phi), eta = g.y - 1.0 - std::cos(g.phi);
    const auto [d, t] = polar(-eta, xi);
    if (d < 2.0) return {};
    const double u = 2.0 - d;
    const double v = wrap_angle(t + kHalfPi - g.phi);
    if (below(t) || above(u) || above(v)) return {};
    return found(t, u, v);
}

// 8.11, L+ R- S- L- R+, the second and the fourth arc quarters of a turn.
Lengths two_quarters(const Target &g) {
    const double xi = g.x + std::sin(g.phi), eta = g.y - 1.0 - std::cos(g.phi);
    const double d = std::hypot(xi, eta);
    if (d < 2.0) return {};
    const double u = 4.0 - std::sqrt(d * d - 4.0);
    if (above(u)) return {};
    const double t = wrap_angle(std::atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta));
    const double v = wrap_angle(t - g.phi);
    if (below(t) || below(v)) return {};
    return found(t, u, v);
}

// Collects the cheapest curve.
class Cheapest {
  public:
    Cheapest(double radius, const GearCosts &costs, int gear, bool backward)
        : radius_(radius), costs_(costs), gear_(gear), backward_(backward) {}

    // A word of the mirror images of a target: time turned round (flip -1), left and right exchanged (side -1), or
    // driven from its end. lengths in radii.
    void take(const CarPiece *pieces, int count, int flip, int side, bool reversed) {
        CarCurve curve;
        for (int k = 0; k < count; ++k) {
            const CarPiece &piece = pieces[reversed ? count - 1 - k : k];
            const double length = flip * piece.length;
            if (std::abs(length) < kNone) continue;
            if (length < 0.0 && !backward_) return;
            curve.pieces[curve.count++] = {radius_ * length, side * piece.turn};
        }
        const double cost = cost_of(curve, costs_, gear_);
        // Words that cost the same but for rounding: the first, on all machines.
        if (cost >= least_ - 1e-12) return;
        least_ = cost;
        best_ = curve;
    }
    const CarCurve &best() const { return best_; }

  private:
    double radius_;
    GearCosts costs_;
    int gear_;
    bool backward_;
    double least_ = std::numeric_limits<double>::infinity();
    CarCurve best_;
};

constexpr int kLeft = 1, kRight = -1, kStraight = 0;

void take_words(const Target &g, int flip, int side, bool reversed, Cheapest &all) {
    const auto take = [&](std::initializer_list<CarPiece> pieces) {
        all.take(pieces.begin(), static_cast<int>(pieces.size()), flip, side, reversed);
    };
    if (const Lengths w = left_right_left(g); w.found) take({{w.t, kLeft}, {w.u, kRight}, {w.v, kLeft}});
    if (const Lengths w = quarter_straight_left(g); w.found)
        take({{w.t, kLeft}, {-kHalfPi, kRight}, {w.u, kStraight}, {w.v, kLeft}});
    if (const Lengths w = quarter_straight_right(g); w.found)
        take({{w.t, kLeft}, {-kHalfPi, kRight}, {w.u, kStraight}, {w.v, kRight}});
    if (reversed) return; // the others are their own when driven from their ends
    if (const Lengths w = left_straight_left(g); w.found) take({{w.t, kLeft}, {w.u, kStraight}, {w.v, kLeft}});
    if (const Lengths w = left_straight_right(g); w.found) take({{w.t, kLeft}, {w.u, kStraight}, {w.v, kRight}});
    if (const Lengths w = four_arcs_one_cusp(g); w.found)
        take({{w.t, kLeft}, {w.u, kRight}, {-w.u, kLeft}, {w.v, kRight}});
    if (const Lengths w = four_arcs_two_cusps(g); w.found)
        take({{w.t, kLeft}, {w.u, kRight}, {w.u, kLeft}, {w.v, kRight}});
    if (const Lengths w = two_quarters(g); w.found)
        take({{w.t, kLeft}, {-kHalfPi, kRight}, {w.u, kStraight}, {-kHalfPi, kLeft}, {w.v, kRight}});
}

} // namespace

double length_of(const CarCurve &curve) { return cost_of(curve, {}, kEitherGear); }

double cost_of(const CarCurve &curve, const GearCosts &costs, int gear) {
    double cost = 0.0;
    for (int k = 0; k < curve.count; ++k) {
        const double length = curve.pieces[k].length;
        const int now = length < 0.0 ? -1 : 1;
        if (gear != kEitherGear && now != gear) cost += costs.cusp;
        gear = now;
        cost += length < 0.0 ? -length * (1.0 + costs.backward) : length;
    }
    return cost;
}

Pose drive_piece(const Pose &from, const CarPiece &piece, double length, double radius) {
    const double half = 0.5 * piece.turn * length / radius;
    const double chord = piece.turn == 0 ? length : 2.0 * radius * std::sin(half) * piece.turn;
    return {from.x + chord * std::cos(from.theta + half), from.y + chord * std::sin(from.theta + half),
            wrap_angle(from.theta + 2.0 * half)};
}

CarCurve reeds_shepp(const Pose &from, const Pose &to, double radius, const GearCosts &costs, int gear, bool backward) {
    const double c = std::cos(from.theta), s = std::sin(from.theta);
    const double dx = (to.x - from.x) / radius, dy = (to.y - from.y) / radius;
    const Target goal{c * dx + s * dy, c * dy - s * dx, wrap_angle(to.theta - from.theta)};
    Cheapest all(radius, costs, gear, backward);
    for (const int flip : {1, -1}) {
        for (const int side : {1, -1}) {
            const Target g{flip * goal.x, side * goal.y, flip * side * goal.phi};
            take_words(g, flip, side, false, all);
            // The same from the end: the start in the frame of the goal, time turned round.
            const double cg = std::cos(g.phi), sg = std::sin(g.phi);
            take_words({g.x * cg + g.y * sg, g.x * sg - g.y * cg, g.phi}, flip, side, true, all);
        }
    }
    return all.best();
}

} // namespace adrl
