// adrl_act POLICY < rows: one line a control step in, the velocity out.
// A line: ranges; goal x y; speed, yaw rate; last action (2); with motion cues also past ranges, pose x y yaw, past
// pose.
#include <cstdio>
#include <exception>
#include <iostream>

#include "policy.hpp"

int main(int argc, char **argv) {
    if (argc != 2) {
        std::cerr << "usage: adrl_act POLICY.safetensors < rows\n";
        return 2;
    }
    try {
        const Policy policy(argv[1]);
        Look now, past;
        now.ranges.resize(policy.num_beams());
        past.ranges.resize(policy.num_beams());
        const auto read = [](auto &...values) { return static_cast<bool>((std::cin >> ... >> values)); };
        while (true) {
            for (float &range : now.ranges) read(range);
            adrl::Vec2 goal;
            adrl::Twist twist;
            Action last;
            read(goal.x, goal.y, twist.v, twist.w, last.speed, last.turn);
            if (policy.history_steps() > 0) {
                for (float &range : past.ranges) read(range);
                read(now.pose.x, now.pose.y, now.pose.theta, past.pose.x, past.pose.y, past.pose.theta);
            }
            if (!std::cin) return 0;
            const adrl::Twist velocity = policy.velocity(policy.act(now, past, goal, twist, last));
            std::printf("%.9g %.9g\n", velocity.v, velocity.w);
        }
    } catch (const std::exception &error) {
        std::cerr << "adrl_act: " << error.what() << "\n";
        return 1;
    }
}
