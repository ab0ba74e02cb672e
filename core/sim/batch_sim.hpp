// N robots of several kinds stepped at once, each in its own world. All that changes lives in arrays owned by the
// caller; a step allocates nothing, and its results depend on neither the number of threads nor their order.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "control/local_control.hpp"
#include "drive/collision.hpp"
#include "drive/kinematics.hpp"
#include "planning/path.hpp"
#include "planning/path_guide.hpp"
#include "thread_pool.hpp"
#include "world/people.hpp"
#include "world/raycast.hpp"
#include "world/world.hpp"

namespace adrl {

struct Robot {
    Footprint footprint;
    DriveLimits limits;
    Beams beams;
    Pose mount; // of the LiDAR, in the robot's frame
    double max_range = 6.0;
    double dt_s = 0.1;
};

struct Task {
    std::shared_ptr<const World> world;
    Pose start;
    Vec2 goal;
    double goal_tolerance = 0.3;
    Path path;
    std::shared_ptr<const Crowd> crowd; // null where nobody walks; the world's walls are laid
};

// Columns of the `params` array: what may differ from robot to robot and from episode to episode.
enum Param : int {
    kSpeedGain, // executed over commanded speed; 1 is nominal
    kYawGain,
    kMaxAcceleration,
    kMaxYawAcceleration,
    kLag,
    kLatency,
    kRangeNoise, // metres
    kDropout,    // chance a beam
    kOdometrySpeedError,
    kOdometryYawError, // relative
    kNumParams
};

// Commands of the latest kHistory periods are kept, so latency may be up to kHistory - 1 periods.
inline constexpr int kHistory = 9;
// Columns of the `memory` array: arc length along the path, steps done, then commands, newest first.
inline constexpr int kMemory = 2 + 2 * kHistory;

// Row i belongs to robot i. All arrays are C-contiguous.
struct SimBuffers {
    const std::int64_t *kind;   // (N) what each robot is, by its number
    int num_columns;            // K, the most beams of any kind
    const double *command;      // (N, 2) speed, yaw rate
    const std::uint8_t *active; // (N) rows that step() moves
    const std::uint64_t *seed;  // (N) of the noise
    const double *params;       // (N, kNumParams)
    float *ranges;              // (N, K); beyond a robot's own beams its greatest range
    double *pose;               // (N, 3) true
    double *odometry;           // (N, 3) dead reckoning, starts at the true pose
    double *twist;              // (N, 2) executed
    double *clearance;          // (N) from the footprint's edge, at the end of the step
    double *least_clearance;    // (N) during the step
    double *waypoint;           // (N, 2) point of the path to head for
    double *path_ahead;         // (N, kPathAhead, 2) points of the path ahead; null where nobody asks
    double *route_left;         // (N) metres of path left
    double *time;               // (N) seconds since the start
    double *travelled;          // (N) metres driven
    std::uint8_t *reached;      // (N)
    std::uint8_t *collided;     // (N)
    std::uint8_t *at_fault;     // (N) collided, and moved into what it touches
    double *memory;             // (N, kMemory)
    double *people;             // (N, kMaxPeople, kPersonNumbers) a Person each; those beyond the crowd's mean nothing
};

struct SimConfig {
    double clearance_limit = 1.0;   // clearances are reported up to this, metres
    double lookahead = 1.5;         // of the waypoint, metres along the path; 0 leaves the waypoint at the goal
    double search = 3.0;            // robots are looked for so far ahead of where they were on their paths
    bool waypoint_is_given = false; // others write the waypoints: a replanner
};

// How such robots are led along their paths.
GuideRules guide_rules(const Robot &robot, const SimConfig &config);

// What a robot is, and how it is led.
struct SimKind {
    SimKind(Robot of, const SimConfig &how) : robot(std::move(of)), config(how), rules(guide_rules(robot, config)) {}

    Robot robot;
    SimConfig config;
    GuideRules rules;
};

class BatchSim {
  public:
    BatchSim(int num_envs, int num_threads, std::vector<SimKind> kinds, SimBuffers buffers);

    int num_envs() const { return num_envs_; }
    std::size_t num_kinds() const { return kinds_.size(); }
    int num_threads() const { return pool_.size(); }
    void set_task(int i, std::shared_ptr<const Task> task) { tasks_[i] = std::move(task); }
    // Another path for robot i, in another task of the same place and goal: it is led along it from its begin.
    void set_path(int i, std::shared_ptr<const Task> task);
    // Puts the robots of the mask at their tasks' starts, at rest, and senses. mask is (N).
    void reset(const std::uint8_t *mask);
    // Moves every active robot by one control period and senses.
    void step();
    // For robots that something else has moved by the commands in the buffers, from the poses before (N, 3) to those
    // there: whether the active ones have arrived, their clearance and their guidance. Senses nothing; whether they
    // hit, the other tells.
    void follow(const double *before);
    // A command for every active robot of the mask (N) into out (N, 2), along its path with full knowledge of its
    // world.
    void plan(const std::uint8_t *mask, LocalControl &control, double *out);

  private:
    // How old a command is when the base acts on it: whole control periods and the rest.
    struct Delay {
        int whole;
        double rest_s;
    };
    struct Moment {
        Pose pose;
        Twist twist;
        double time_s;
    };

    const SimKind &kind_of(int i) const { return kinds_[static_cast<std::size_t>(b_.kind[i])]; }
    static Delay delay_of(double latency_s, double dt_s);
    // When the base will act on a command that is given now, after those that are on their way.
    Moment when_acted(int i, const DriveLimits &limits) const;
    void reset_one(int i);
    void step_one(int i);
    void remember_command(int i); // of this period, the newest of those on their way to the base
    void follow_one(int i, Vec2 before);
    bool arrived(int i, Vec2 before) const;
    void sense(int i);
    void guide(int i);
    Person *people(int i) const; // null where nobody walks
    // What moves about robot i, from now on.
    Moving moving(int i) const { return {*tasks_[i]->world, tasks_[i]->crowd.get(), people(i), b_.time[i]}; }

    int num_envs_;
    std::vector<SimKind> kinds_;
    SimBuffers b_;
    std::vector<std::shared_ptr<const Task>> tasks_;
    ThreadPool pool_;
};

} // namespace adrl
