// World plugin: robots of one kind, driven from outside in lock-step.
//
// Gazebo's own thread blocks after each control period until the next message comes, so no simulated time passes
// unnoticed and nothing spins. The plugin connects to 127.0.0.1:<port>, where the program that started Gazebo
// listens, and ends Gazebo when that closes the connection. Every number is little-endian, as the processor has it.
//
// Messages to the plugin, each answered with the state:
//   'F' u32 slot, u32 boxes, u32 cylinders, u32 discs, u32 length, boxes x 5 f64, cylinders x 3 f64, discs x 8 f64, text
//       What stands around robot `slot`, instead of what stood there. Box: x, y, yaw, length, width; cylinder: x, y,
//       radius. Disc j, the model disc_<slot>_<j>, moves to and fro between its two ends: x1, y1, x2, y2, radius, speed,
//       phase, stop_s. The text, an SDF document with one <world>, holds the models that the slot lacks: of stock_...
//       boxes and cylinders are taken and kept for the worlds to come, as are discs; others are for this one.
//   'R' u32 slot, u32 seed, f64 x, y, yaw
//       Robot `slot` stands at the pose, at rest. Seeds Gazebo's noise, of which all robots draw in turn.
//   'S' N x (f64 speed, yaw rate), N x u8 active
//       One control period. Robots that are not active get the command to stand, and sense nothing.
// State: N x (11 f64, K f32): x, y, yaw; odometry x, y, yaw; speed, yaw rate, from the wheels; metres driven and
//   seconds until contact in this period; 1 for contact; then the ranges, infinite where nothing is hit. With an imu,
//   yaw rate and heading of the odometry are its, not the wheels'.
//
// <plugin>: port, robots (N), steps (of physics in a control period), radius and separation of the wheels, as the
//   base's controller takes them, torque of each, reach (range below which a robot may touch something in the next
//   period), speed (2: least, greatest), yaw_rate, acceleration, yaw_acceleration, lag, latency; imu (2, if there is
//   one: standard deviations of the heading's error, drawn at each reset, and of the yaw rate's noise). Robot i is the
//   model robot_<i> with joints left... and right..., a collision "footprint" and a ray sensor "lidar".
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include <gazebo/common/common.hh>
#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>
#include <ignition/math/Rand.hh>

#include "line.hpp"
#include "obstacles.hpp"

namespace adrl {

using gazebo::physics::ModelPtr;

struct Twist {
    double v = 0.0, w = 0.0;
};

struct Robot {
    ModelPtr model;
    std::vector<gazebo::physics::JointPtr> left, right; // the wheels of each side
    gazebo::sensors::RaySensorPtr lidar;
    std::vector<ModelPtr> passing; // models of this world alone
    std::vector<gazebo::physics::CollisionPtr> boxes, cylinders;
    std::vector<Disc> discs;
    std::deque<Twist> commands; // newest first, one a physics step of the latency
    Twist wanted, target, executed;
    double odometry[3] = {};
    double driven = 0.0, free_s = 0.0, clock = 0.0, fastest_disc = 0.0, heading_error = 0.0;
    bool contact = false, active = false;
};

// Of the rims of these wheels, on average.
double rim_speed(const std::vector<gazebo::physics::JointPtr> &wheels, double radius) {
    double sum = 0.0;
    for (const auto &wheel : wheels) sum += wheel->GetVelocity(0);
    return radius * sum / static_cast<double>(wheels.size());
}

// A first-order lag within the acceleration limit, as advance_twist in core/drive/kinematics.cpp.
double approach(double value, double goal, double response, double largest_change) {
    return value + std::clamp(response * (goal - value), -largest_change, largest_change);
}

namespace physics = gazebo::physics;
namespace sensors = gazebo::sensors;
namespace event = gazebo::event;

class Lockstep : public gazebo::WorldPlugin {
  public:
    void Load(physics::WorldPtr world, sdf::ElementPtr sdf) override {
        world_ = world;
        robots_.resize(sdf->Get<unsigned>("robots"));
        steps_ = sdf->Get<int>("steps");
        radius_ = sdf->Get<double>("radius");
        separation_ = sdf->Get<double>("separation");
        torque_ = sdf->Get<double>("torque");
        reach_ = sdf->Get<double>("reach");
        const auto speed = sdf->Get<ignition::math::Vector2d>("speed");
        min_speed_ = speed.X();
        max_speed_ = speed.Y();
        max_yaw_rate_ = sdf->Get<double>("yaw_rate");
        acceleration_ = sdf->Get<double>("acceleration");
        yaw_acceleration_ = sdf->Get<double>("yaw_acceleration");
        dt_s_ = world->Physics()->GetMaxStepSize();
        const double lag_s = sdf->Get<double>("lag");
        response_ = lag_s > 0.0 ? -std::expm1(-dt_s_ / lag_s) : 1.0;
        if (sdf->HasElement("imu")) {
            const auto imu = sdf->Get<ignition::math::Vector2d>("imu");
            has_imu_ = true;
            heading_std_ = imu.X();
            yaw_rate_std_ = imu.Y();
        }
        delay_ = static_cast<std::size_t>(std::lround(sdf->Get<double>("latency") / dt_s_));
        world->Physics()->SetRealTimeUpdateRate(0.0); // as fast as it can
        line_.connect(sdf->Get<int>("port"));
        begin_ = event::Events::ConnectWorldUpdateBegin([this](const gazebo::common::UpdateInfo &) { drive(); });
        end_ = event::Events::ConnectWorldUpdateEnd([this] { after_step(); });
    }

  private:
    // Robots and sensors appear some updates after the world, cameras last.
    bool find_robots() {
        if (!sensors::SensorManager::Instance()->SensorsInitialized()) return false;
        for (std::size_t i = 0; i < robots_.size(); ++i) {
            Robot &robot = robots_[i];
            const std::string name = "robot_" + std::to_string(i);
            if (!robot.model) robot.model = world_->ModelByName(name);
            if (!robot.model) return false;
            auto *sensors = sensors::SensorManager::Instance();
            const auto found = sensors->GetSensor(world_->Name() + "::" + name + "::base::lidar");
            robot.lidar = std::dynamic_pointer_cast<sensors::RaySensor>(found);
            if (!robot.lidar || !robot.lidar->LaserShape()) return false;
            robot.left.clear();
            robot.right.clear();
            for (const auto &joint : robot.model->GetJoints()) {
                const std::string &wheel = joint->GetName();
                if (wheel.rfind("left", 0) == 0) robot.left.push_back(joint);
                if (wheel.rfind("right", 0) == 0) robot.right.push_back(joint);
                joint->SetParam("fmax", 0, torque_);
            }
            const auto footprint = robot.model->GetLink("base")->GetCollision("footprint");
            if (robot.left.empty() || robot.right.empty() || !footprint) end("robot without wheels or footprint");
            owner_[footprint.get()] = i;
            robot.commands.assign(delay_ + 1, {});
        }
        return true;
    }

    // Before a step of physics: the base follows its command with its lag, within its acceleration limits.
    void drive() {
        if (!ready_) return;
        for (Robot &robot : robots_) {
            robot.commands.push_front(robot.wanted);
            robot.commands.pop_back();
            const Twist due = robot.commands.back();
            robot.target.v = approach(robot.target.v, due.v, response_, acceleration_ * dt_s_);
            robot.target.w = approach(robot.target.w, due.w, response_, yaw_acceleration_ * dt_s_);
            const double side = 0.5 * separation_ * robot.target.w;
            turn(robot, (robot.target.v - side) / radius_, (robot.target.v + side) / radius_);
            if (robot.active) robot.clock += dt_s_;
            for (const Disc &disc : robot.discs) place(disc, robot.clock);
        }
    }

    // The motors' wanted speeds, rad/s.
    static void turn(const Robot &robot, double left, double right) {
        for (const auto &wheel : robot.left) wheel->SetParam("vel", 0, left);
        for (const auto &wheel : robot.right) wheel->SetParam("vel", 0, right);
    }

    void after_step() {
        if (!ready_) {
            ready_ = find_robots();
            if (ready_) serve();
            return;
        }
        const auto *contacts = world_->Physics()->GetContactManager();
        for (unsigned i = 0; i < contacts->GetContactCount(); ++i) {
            const physics::Contact *contact = contacts->GetContact(i);
            if (contact->count == 0) continue;
            for (const auto *collision : {contact->collision1, contact->collision2}) {
                const auto found = owner_.find(collision);
                if (found != owner_.end()) robots_[found->second].contact = true;
            }
        }
        for (Robot &robot : robots_) measure(robot);
        if (--remaining_ <= 0) {
            send_state();
            serve();
        }
    }

    // What the wheels' encoders and the IMU tell, and what was driven before contact.
    void measure(Robot &robot) {
        const double left = rim_speed(robot.left, radius_), right = rim_speed(robot.right, radius_);
        robot.executed = {0.5 * (left + right), (right - left) / separation_};
        double *pose = robot.odometry;
        double next = pose[2] + robot.executed.w * dt_s_;
        if (has_imu_) {
            robot.executed.w = robot.model->WorldAngularVel().Z();
            next = robot.model->WorldPose().Rot().Yaw() + robot.heading_error;
        }
        const double heading = pose[2] + 0.5 * std::remainder(next - pose[2], 2.0 * M_PI);
        pose[0] += robot.executed.v * dt_s_ * std::cos(heading);
        pose[1] += robot.executed.v * dt_s_ * std::sin(heading);
        pose[2] = std::remainder(next, 2.0 * M_PI);
        if (robot.contact) return;
        const auto velocity = robot.model->WorldLinearVel();
        robot.driven += std::hypot(velocity.X(), velocity.Y()) * dt_s_;
        robot.free_s += dt_s_;
    }

    // Answers messages until one lets time pass.
    void serve() {
        for (;;) {
            const char kind = line_.read<char>();
            if (kind == 'F') {
                furnish();
                send_state();
            } else if (kind == 'R') {
                reset();
                send_state();
            } else if (kind == 'S') {
                std::vector<Twist> commands(robots_.size());
                std::vector<std::uint8_t> active(robots_.size());
                line_.read(commands.data(), commands.size() * sizeof(Twist));
                line_.read(active.data(), active.size());
                for (std::size_t i = 0; i < robots_.size(); ++i) {
                    Robot &robot = robots_[i];
                    robot.active = active[i] != 0;
                    robot.wanted = robot.active ? commands[i] : Twist{};
                    robot.wanted.v = std::clamp(robot.wanted.v, min_speed_, max_speed_);
                    robot.wanted.w = std::clamp(robot.wanted.w, -max_yaw_rate_, max_yaw_rate_);
                    robot.driven = robot.free_s = 0.0;
                    robot.contact = false;
                }
                remaining_ = steps_;
                return;
            } else {
                end("unknown message");
            }
        }
    }

    Robot &addressed(std::uint32_t slot) {
        if (slot >= robots_.size()) end("no such robot");
        return robots_[slot];
    }

    void reset() {
        Robot &robot = addressed(line_.read<std::uint32_t>());
        const auto seed = line_.read<std::uint32_t>();
        std::array<double, 3> start;
        line_.read(start.data(), sizeof start);
        ignition::math::Rand::Seed(seed);
        world_->Physics()->SetSeed(seed);
        robot.clock = robot.driven = robot.free_s = 0.0;
        robot.contact = false;
        robot.active = true;
        robot.wanted = robot.target = robot.executed = {};
        robot.commands.assign(delay_ + 1, {});
        std::copy(start.begin(), start.end(), robot.odometry);
        if (has_imu_) robot.heading_error = ignition::math::Rand::DblNormal(0.0, heading_std_);
        robot.odometry[2] += robot.heading_error;
        turn(robot, 0.0, 0.0);
        robot.model->SetWorldPose({start[0], start[1], 0.0, 0.0, 0.0, start[2]});
        robot.model->ResetPhysicsStates();
        for (const Disc &disc : robot.discs) place(disc, 0.0);
    }

    template <std::size_t N> std::vector<std::array<double, N>> read_rows(std::size_t count) {
        std::vector<std::array<double, N>> rows(count);
        line_.read(rows.data(), count * sizeof rows[0]);
        return rows;
    }

    void furnish() {
        const auto slot = line_.read<std::uint32_t>();
        Robot &robot = addressed(slot);
        std::array<std::uint32_t, 4> counts;
        line_.read(counts.data(), sizeof counts);
        const auto boxes = read_rows<5>(counts[0]);
        const auto cylinders = read_rows<3>(counts[1]);
        const auto discs = read_rows<8>(counts[2]);
        std::string text(counts[3], '\0');
        line_.read(text.data(), text.size());
        for (const ModelPtr &model : robot.passing) {
            robot.model->GetParent()->RemoveChild(model->GetName());
            model->Fini();
        }
        robot.passing.clear();
        if (!text.empty()) load(robot, text);
        if (boxes.size() > robot.boxes.size() || cylinders.size() > robot.cylinders.size()) end("stock is too small");
        for (std::size_t i = 0; i < robot.boxes.size(); ++i) {
            if (i < boxes.size()) stand_box(robot.boxes[i], boxes[i]);
            else store(robot.boxes[i]);
        }
        for (std::size_t i = 0; i < robot.cylinders.size(); ++i) {
            if (i < cylinders.size()) stand_cylinder(robot.cylinders[i], cylinders[i]);
            else store(robot.cylinders[i]);
        }
        arrange_discs(robot, slot, discs);
    }

    void arrange_discs(Robot &robot, std::uint32_t slot, const std::vector<std::array<double, 8>> &rows) {
        robot.discs.clear();
        robot.fastest_disc = 0.0;
        for (std::size_t j = 0;; ++j) {
            const ModelPtr model = world_->ModelByName("disc_" + std::to_string(slot) + "_" + std::to_string(j));
            if (!model && j < rows.size()) end("stock of discs is too small");
            if (!model) return;
            const auto body = model->GetLinks().front()->GetCollisions().front();
            if (j >= rows.size()) {
                model->SetWorldPose({0.0, 0.0, kCellar, 0.0, 0.0, 0.0});
                continue;
            }
            cylinder_of(body)->SetSize(rows[j][4], kHeight);
            robot.discs.push_back({model, rows[j]});
            robot.fastest_disc = std::max(robot.fastest_disc, rows[j][5]);
            place(robot.discs.back(), 0.0);
        }
    }

    // Not through the factory topic, which would let simulated time pass before the models are there.
    void load(Robot &robot, const std::string &text) {
        sdf::SDF document;
        document.SetFromString(text);
        for (auto element = document.Root()->GetElement("world")->GetElement("model"); element;
             element = element->GetNextElement("model")) {
            const ModelPtr model = world_->Physics()->CreateModel(robot.model->GetParent());
            model->SetWorld(world_);
            model->Load(element);
            model->Init();
            const std::string name = model->GetName();
            if (name.rfind("stock_", 0) == 0) {
                for (const auto &body : model->GetLinks().front()->GetCollisions()) {
                    auto &shelf = body->GetShape()->HasType(physics::Base::BOX_SHAPE) ? robot.boxes : robot.cylinders;
                    shelf.push_back(body);
                }
            } else if (name.rfind("disc_", 0) != 0) {
                robot.passing.push_back(model);
            }
        }
    }

    void send_state() {
        reply_.clear();
        bool near = false;
        for (Robot &robot : robots_) {
            const auto pose = robot.model->WorldPose();
            const double *odometry = robot.odometry;
            if (has_imu_) robot.executed.w += ignition::math::Rand::DblNormal(0.0, yaw_rate_std_);
            const double numbers[11] = {pose.Pos().X(),   pose.Pos().Y(),  pose.Rot().Yaw(),
                                        odometry[0],      odometry[1],     odometry[2],
                                        robot.executed.v, robot.executed.w, robot.driven,
                                        robot.free_s,     robot.contact ? 1.0 : 0.0};
            append(numbers, sizeof numbers);
            if (robot.active) robot.lidar->Update(true);
            robot.lidar->Ranges(ranges_);
            single_.assign(robot.lidar->RayCount(), 0.0f);
            std::copy_n(ranges_.begin(), std::min(ranges_.size(), single_.size()), single_.begin());
            append(single_.data(), single_.size() * sizeof(float));
            const auto nearest = std::min_element(single_.begin(), single_.end());
            near = near || (robot.active && *nearest < reach_ + robot.fastest_disc * steps_ * dt_s_);
        }
        // Gazebo keeps contacts when it is told to, all of them, and those of the wheels cost as much as the physics: so
        // only while the LiDAR sees something that a robot may touch in the next period.
        world_->Physics()->GetContactManager()->SetNeverDropContacts(near);
        line_.write(reply_);
    }

    void append(const void *data, std::size_t bytes) {
        const auto *first = static_cast<const char *>(data);
        reply_.insert(reply_.end(), first, first + bytes);
    }

    physics::WorldPtr world_;
    Line line_;
    std::vector<Robot> robots_;
    std::map<const physics::Collision *, std::size_t> owner_;
    std::vector<double> ranges_;
    std::vector<float> single_;
    std::vector<char> reply_;
    event::ConnectionPtr begin_, end_;
    int steps_ = 25, remaining_ = 0;
    std::size_t delay_ = 0;
    double dt_s_ = 0.004, radius_ = 0.0, separation_ = 0.0, torque_ = 0.0, reach_ = 0.0;
    double min_speed_ = 0.0, max_speed_ = 0.0, max_yaw_rate_ = 0.0, acceleration_ = 0.0, yaw_acceleration_ = 0.0;
    double response_ = 1.0, heading_std_ = 0.0, yaw_rate_std_ = 0.0;
    bool ready_ = false, has_imu_ = false;
};

GZ_REGISTER_WORLD_PLUGIN(Lockstep)

} // namespace adrl
