// What a robot has seen: a window of log-odds cells that moves with it, filled from its own scans.
#pragma once

#include <cstdint>
#include <vector>

#include "world/geometry.hpp"
#include "world/raycast.hpp"

namespace adrl {

// A cell holds twice its evidence, less one ever since it was once as surely free as can be. Above 0 it is solid, at 0
// nothing is known of it. One hit makes the most surely free cell solid (low + hit > 0); high / miss scans that see
// through a cell forget what stood there.
struct Evidence {
    int hit = 30;
    int miss = 6;
    int low = -20;
    int high = 60;

    // What a cell of a wall holds, and no other: what is surely solid, and has never been surely free. All else that is
    // solid may have come, and may go, as people do. Where hit is less than high, one scan makes no wall yet.
    std::int8_t wall() const { return static_cast<std::int8_t>(2 * high); }
    // What a cell holds that is surely free.
    std::int8_t free() const { return static_cast<std::int8_t>(2 * low - 1); }
};

struct WindowShape {
    int height = 400;
    int width = 400;
    double resolution = 0.05;
};

// The lattice cell that is the window's (0, 0). Lattice cell (r, c) covers [c, c+1) x [r, r+1) times the resolution.
struct WindowOrigin {
    std::int64_t row = 0;
    std::int64_t column = 0;
};

// Forgets all and puts the robot in the window's middle.
void clear_window(std::int8_t *log_odds, const WindowShape &shape, WindowOrigin &origin, Vec2 robot);

// Moves the window once the robot has come within a quarter of the side of a border, and no farther than needed: what
// lies behind the robot is often the way back.
void follow_robot(std::int8_t *log_odds, const WindowShape &shape, WindowOrigin &origin, Vec2 robot);

// True when no solid cell's centre is within `radius` of the straight line. Near `from` less is asked: what the robot
// has around itself already, half a metre more for every metre on, so that it may leave a place that is too narrow.
// Cells outside the window and cells never seen count as free; with `known`, those on the line itself do not.
bool corridor_seen_free(const std::int8_t *log_odds, const WindowShape &shape, const WindowOrigin &origin, Vec2 from,
                        Vec2 to, double radius, bool known = false);

// Whose scans they are, and what they count for.
struct Scanner {
    // Hits farther than `reach` are left out: the window is small. Cells within body_radius of the robot are free.
    Scanner(const Evidence &evidence, const Beams &beams, const Pose &mount, double max_range, double reach,
            double body_radius);

    Evidence evidence;
    Pose mount;
    double max_range;
    double reach;
    double body_radius;
    bool full_circle;
    std::vector<double> local_x, local_y; // beam directions in the robot's frame
};

// Enters scans into windows, for robots of any kind. Owns the scratch: one a thread.
class ScanIntegrator {
  public:
    ScanIntegrator(const WindowShape &shape, int most_beams);

    // ranges (K). Each cell gets evidence once a scan, and a hit outweighs beams that pass: a wall seen at a grazing
    // angle is not worn away. For the same reason a beam sees no farther than its two neighbours. A range that is not
    // positive, or NaN, tells nothing. Every second beam is traced, by turns (parity 0 or 1); all hits are entered.
    void integrate(const Scanner &scanner, std::int8_t *log_odds, const WindowOrigin &origin, const Pose &robot,
                   const float *ranges, int parity);

  private:
    void enter_hits(const Scanner &scanner, std::int8_t *log_odds, Vec2 sensor, const float *ranges);
    void trace(const Evidence &evidence, std::int8_t *log_odds, Vec2 sensor, Vec2 direction, double length);
    void free_body(const Scanner &scanner, std::int8_t *log_odds, Vec2 robot);

    WindowShape shape_;
    std::vector<Vec2> directions_;   // of the beams in the world, of the scan at hand
    std::vector<std::uint8_t> mark_; // equal to epoch_ where this scan has left evidence
    std::uint8_t epoch_ = 0;
};

} // namespace adrl
