#include "sim/batch_sim.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "random.hpp"

namespace adrl {
namespace {

constexpr int kMaxBeams = 2048;

Pose load_pose(const double *row) { return {row[0], row[1], row[2]}; }

void store_pose(double *row, const Pose &pose) {
    row[0] = pose.x;
    row[1] = pose.y;
    row[2] = pose.theta;
}

// Speeds are the robot's, how fast they change is the row's.
DriveLimits limits_of(const Robot &robot, const double *params) {
    DriveLimits limits = robot.limits;
    limits.max_acceleration = params[kMaxAcceleration];
    limits.max_yaw_acceleration = params[kMaxYawAcceleration];
    limits.lag_s = params[kLag];
    return limits;
}

// Range noise and dropouts, one random number a beam from its own counter.
ADRL_CLONES void disturb(const double *exact, int count, std::uint64_t key, double noise, double dropout,
                         double max_range, float *out) {
    for (int i = 0; i < count; ++i) {
        const std::uint64_t bits = mix64(key + static_cast<std::uint64_t>(i));
        double range = exact[i] + noise * nearly_normal(bits);
        range = range < 0.0 ? 0.0 : range;
        range = (range > max_range) | (exact[i] >= max_range) ? max_range : range;
        // Chance of a dropout: a second hash, so that it tells nothing about the noise.
        const double chance = uniform01(mix64(bits));
        out[i] = static_cast<float>(chance < dropout ? max_range : range);
    }
}

ADRL_CLONES void copy_ranges(const double *exact, int count, float *out) {
    for (int i = 0; i < count; ++i) out[i] = static_cast<float>(exact[i]);
}

} // namespace

BatchSim::BatchSim(int num_envs, int num_threads, std::vector<SimKind> kinds, SimBuffers buffers)
    : num_envs_(num_envs), kinds_(std::move(kinds)), b_(buffers), tasks_(num_envs), pool_(num_threads) {}

void BatchSim::reset(const std::uint8_t *mask) {
    pool_.run(num_envs_, [&](int first, int last) {
        for (int i = first; i < last; ++i) {
            if (mask[i] && tasks_[i]) reset_one(i);
        }
    });
}

void BatchSim::step() {
    pool_.run(num_envs_, [&](int first, int last) {
        for (int i = first; i < last; ++i) {
            if (b_.active[i] && tasks_[i]) step_one(i);
        }
    });
}

void BatchSim::follow(const double *before) {
    pool_.run(num_envs_, [&](int first, int last) {
        for (int i = first; i < last; ++i) {
            if (b_.active[i] && tasks_[i]) follow_one(i, {before[3 * i], before[3 * i + 1]});
        }
    });
}

void BatchSim::plan(const std::uint8_t *mask, LocalControl &control, double *out) {
    pool_.run(num_envs_, [&](int first, int last) {
        for (int i = first; i < last; ++i) {
            if (!mask[i] || !b_.active[i] || !tasks_[i]) continue;
            const Task &task = *tasks_[i];
            const SimKind &kind = kind_of(i);
            const DriveLimits limits = limits_of(kind.robot, b_.params + static_cast<std::ptrdiff_t>(i) * kNumParams);
            const Moment then = when_acted(i, limits);
            const double here = b_.memory[static_cast<std::ptrdiff_t>(i) * kMemory];
            const double along =
                come_along(task.path, {then.pose.x, then.pose.y}, here, kind.rules.window, kind.rules.car);
            const Twist command =
                control.in_world(i, moving(i), task.path, along, limits, then.pose, then.twist, then.time_s);
            out[2 * i] = command.v;
            out[2 * i + 1] = command.w;
        }
    });
}

BatchSim::Moment BatchSim::when_acted(int i, const DriveLimits &limits) const {
    const double *params = b_.params + static_cast<std::ptrdiff_t>(i) * kNumParams;
    const double *history = b_.memory + static_cast<std::ptrdiff_t>(i) * kMemory + 2;
    Moment then{load_pose(b_.pose + 3 * i), {b_.twist[2 * i], b_.twist[2 * i + 1]}, b_.time[i]};
    const double dt_s = kind_of(i).robot.dt_s;
    const Delay delay = delay_of(params[kLatency], dt_s);
    for (int age = delay.whole; age >= 0; --age) {
        const double span_s = age == delay.whole ? delay.rest_s : dt_s;
        if (span_s <= 0.0) continue;
        const Twist due{history[2 * age] * params[kSpeedGain], history[2 * age + 1] * params[kYawGain]};
        const Twist next = advance_twist(then.twist, due, limits, span_s);
        then.pose = integrate(then.pose, mean_twist(then.twist, next, limits), span_s);
        then.twist = next;
        then.time_s += span_s;
    }
    return then;
}

BatchSim::Delay BatchSim::delay_of(double latency_s, double dt_s) {
    const double periods = std::min(latency_s / dt_s, kHistory - 1.001);
    const auto whole = static_cast<int>(periods);
    return {whole, (periods - whole) * dt_s};
}

void BatchSim::reset_one(int i) {
    const Task &task = *tasks_[i];
    const SimKind &kind = kind_of(i);
    double *memory = b_.memory + static_cast<std::ptrdiff_t>(i) * kMemory;
    std::fill(memory, memory + kMemory, 0.0);
    store_pose(b_.pose + 3 * i, task.start);
    store_pose(b_.odometry + 3 * i, task.start);
    b_.twist[2 * i] = 0.0;
    b_.twist[2 * i + 1] = 0.0;
    b_.time[i] = 0.0;
    b_.travelled[i] = 0.0;
    if (Person *walkers = people(i)) begin_walk(*task.crowd, b_.seed[i], walkers);
    b_.clearance[i] =
        clearance(*task.world, moving(i).at(0.0), kind.robot.footprint, task.start, kind.config.clearance_limit);
    b_.least_clearance[i] = b_.clearance[i];
    b_.collided[i] = b_.clearance[i] <= 0.0;
    b_.at_fault[i] = 0;
    b_.reached[i] = norm(Vec2{task.start.x, task.start.y} - task.goal) < task.goal_tolerance;
    guide(i);
    sense(i);
}

void BatchSim::step_one(int i) {
    const Task &task = *tasks_[i];
    const SimKind &kind = kind_of(i);
    const double *params = b_.params + static_cast<std::ptrdiff_t>(i) * kNumParams;
    double *memory = b_.memory + static_cast<std::ptrdiff_t>(i) * kMemory;
    remember_command(i);
    const double *history = memory + 2;

    const DriveLimits limits = limits_of(kind.robot, params);
    // The base acts on a command `latency` old: the older one until the newer one is due, then that.
    const Delay delay = delay_of(params[kLatency], kind.robot.dt_s);
    const double spans[2] = {delay.rest_s, kind.robot.dt_s - delay.rest_s};

    Pose pose = load_pose(b_.pose + 3 * i);
    Pose odometry = load_pose(b_.odometry + 3 * i);
    const Vec2 before{pose.x, pose.y};
    Twist twist{b_.twist[2 * i], b_.twist[2 * i + 1]};
    double clear = b_.clearance[i];
    double least = clear;
    double time_s = b_.time[i];
    bool collided = false, at_fault = false;
    Person *walkers = people(i);
    if (walkers != nullptr) {
        const Vec2 velocity{twist.v * std::cos(pose.theta), twist.v * std::sin(pose.theta)};
        decide(*task.world, *task.crowd, {before, velocity, kind.robot.footprint.radius}, time_s, kind.robot.dt_s,
               walkers);
    }
    const Moving around = moving(i);
    for (int part = 0; part < 2 && !collided; ++part) {
        if (spans[part] <= 0.0) continue;
        const double *due = history + 2 * (delay.whole + 1 - part);
        const Twist wanted{due[0] * params[kSpeedGain], due[1] * params[kYawGain]};
        const Twist next = advance_twist(twist, wanted, limits, spans[part]);
        const Twist mean = mean_twist(twist, next, limits);
        const Motion motion =
            drive(around, kind.robot.footprint, pose, mean, time_s, spans[part], clear, kind.config.clearance_limit);
        odometry = integrate(odometry,
                             {mean.v * (1.0 + params[kOdometrySpeedError]), mean.w * (1.0 + params[kOdometryYawError])},
                             motion.moved_s);
        b_.travelled[i] += std::abs(mean.v) * motion.moved_s;
        time_s += motion.moved_s;
        pose = motion.pose;
        twist = next;
        clear = motion.final_clearance;
        least = std::min(least, motion.clearance);
        collided = motion.collided;
        at_fault = motion.at_fault;
    }
    if (walkers != nullptr) walk(*task.crowd, time_s - b_.time[i], walkers);
    store_pose(b_.pose + 3 * i, pose);
    store_pose(b_.odometry + 3 * i, odometry);
    b_.twist[2 * i] = collided ? 0.0 : twist.v;
    b_.twist[2 * i + 1] = collided ? 0.0 : twist.w;
    b_.clearance[i] = clear;
    b_.least_clearance[i] = least;
    b_.collided[i] = collided;
    b_.at_fault[i] = at_fault;
    b_.time[i] = time_s;
    memory[1] += 1.0;
    b_.reached[i] = arrived(i, before);
    guide(i);
    sense(i);
}

void BatchSim::remember_command(int i) {
    double *history = b_.memory + static_cast<std::ptrdiff_t>(i) * kMemory + 2;
    std::copy_backward(history, history + 2 * (kHistory - 1), history + 2 * kHistory);
    const Twist command = clip_command({b_.command[2 * i], b_.command[2 * i + 1]}, kind_of(i).robot.limits);
    history[0] = command.v;
    history[1] = command.w;
}

void BatchSim::follow_one(int i, Vec2 before) {
    remember_command(i);
    const Task &task = *tasks_[i];
    const SimKind &kind = kind_of(i);
    const Pose pose = load_pose(b_.pose + 3 * i);
    const double clear =
        clearance(*task.world, moving(i).at(b_.time[i]), kind.robot.footprint, pose, kind.config.clearance_limit);
    b_.least_clearance[i] = std::min(b_.clearance[i], clear);
    b_.clearance[i] = clear;
    b_.reached[i] = arrived(i, before);
    guide(i);
}

Person *BatchSim::people(int i) const {
    if (!tasks_[i]->crowd) return nullptr;
    return reinterpret_cast<Person *>(b_.people + static_cast<std::ptrdiff_t>(i) * kMaxPeople * kPersonNumbers);
}

bool BatchSim::arrived(int i, Vec2 before) const {
    // A fast robot may cross the goal's disc between two instants: the chord counts, not its end alone.
    const Task &task = *tasks_[i];
    const Vec2 after{b_.pose[3 * i], b_.pose[3 * i + 1]};
    return !b_.collided[i] && origin_to_segment(before - task.goal, after - task.goal) < task.goal_tolerance;
}

void BatchSim::sense(int i) {
    const Task &task = *tasks_[i];
    const Robot &robot = kind_of(i).robot;
    const double *params = b_.params + static_cast<std::ptrdiff_t>(i) * kNumParams;
    const double *memory = b_.memory + static_cast<std::ptrdiff_t>(i) * kMemory;
    alignas(64) double exact[kMaxBeams + kLanes];
    const Pose sensor = compose(load_pose(b_.pose + 3 * i), robot.mount);
    raycast(*task.world, moving(i).seen_at(b_.time[i]), sensor, robot.beams, robot.max_range, exact);
    float *out = b_.ranges + static_cast<std::ptrdiff_t>(i) * b_.num_columns;
    if (params[kRangeNoise] > 0.0 || params[kDropout] > 0.0) {
        disturb(exact, robot.beams.count(), random_key(b_.seed[i], static_cast<std::uint64_t>(memory[1])),
                params[kRangeNoise], params[kDropout], robot.max_range, out);
    } else {
        copy_ranges(exact, robot.beams.count(), out);
    }
    std::fill(out + robot.beams.count(), out + b_.num_columns, static_cast<float>(robot.max_range));
}

void BatchSim::set_path(int i, std::shared_ptr<const Task> task) {
    set_task(i, std::move(task));
    b_.memory[static_cast<std::ptrdiff_t>(i) * kMemory] = 0.0;
    guide(i);
}

void BatchSim::guide(int i) {
    const Task &task = *tasks_[i];
    const SimKind &kind = kind_of(i);
    double &along = b_.memory[static_cast<std::ptrdiff_t>(i) * kMemory];
    const Guided guided = follow_path(*task.world, task.path, kind.rules, {b_.pose[3 * i], b_.pose[3 * i + 1]}, along);
    along = guided.along;
    b_.route_left[i] = guided.left;
    if (kind.config.waypoint_is_given) return;
    const Vec2 waypoint = kind.rules.lookahead > 0.0 ? guided.waypoint : task.goal;
    b_.waypoint[2 * i] = waypoint.x;
    b_.waypoint[2 * i + 1] = waypoint.y;
    if (b_.path_ahead == nullptr) return;
    // Led to the goal alone a robot knows of no path: all points are the goal.
    const double from = kind.rules.lookahead > 0.0 ? along : task.path.length();
    path_ahead(task.path, from, b_.path_ahead + static_cast<std::ptrdiff_t>(i) * 2 * kPathAhead.size());
}

GuideRules guide_rules(const Robot &robot, const SimConfig &config) {
    constexpr double kMargin = 0.015; // metres beside the robot on the straight line to its waypoint
    return {config.lookahead, config.search, robot.footprint.radius + kMargin, robot.limits.is_car()};
}

} // namespace adrl
