// adrl_act POLICY < rows: one line a control step in, the velocity out.
// A line: ranges; goal x y; speed, yaw rate; last action (2); for a policy that is told the path x y of each of its
// points; with motion cues also past ranges, pose x y yaw, past pose; with tracks also ranges and pose x y yaw of each
// of the last scans, the oldest first. A line of another length, or with something that is no number, ends the program
// with an error; inf and nan are numbers.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "policy.hpp"

namespace {

std::vector<double> numbers_of(const std::string &line) {
    std::vector<double> numbers;
    for (const char *at = line.c_str();;) {
        at += std::strspn(at, " \t\r");
        if (*at == '\0') return numbers;
        char *end = nullptr;
        numbers.push_back(std::strtod(at, &end)); // unlike a stream it reads inf and nan
        if (end == at) throw std::runtime_error("no number: " + std::string(at, std::strcspn(at, " \t\r")));
        at = end;
    }
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 2) {
        std::cerr << "usage: adrl_act POLICY.safetensors < rows\n";
        return 2;
    }
    try {
        const Policy policy(argv[1]);
        const std::size_t beams = policy.num_beams();
        const bool cued = policy.history_steps() > 0;
        const std::size_t points = policy.path_points().size();
        const std::size_t followed = policy.num_followed();
        const std::size_t width = (cued ? 2 * beams + 12 : beams + 6) + 2 * points + followed * (beams + 3);
        std::string line;
        for (int number = 1; std::getline(std::cin, line); ++number) {
            const std::vector<double> row = numbers_of(line);
            if (row.size() != width) {
                throw std::runtime_error("line " + std::to_string(number) + " has " + std::to_string(row.size()) +
                                         " numbers, this policy takes " + std::to_string(width));
            }
            const double *at = row.data() + beams;
            Look now{{row.data(), at}, {}}, past;
            const adrl::Vec2 goal{at[0], at[1]};
            const adrl::Twist twist{at[2], at[3]};
            const Action last{static_cast<float>(at[4]), static_cast<float>(at[5])};
            at += 6;
            std::vector<adrl::Vec2> path;
            for (std::size_t k = 0; k < points; ++k, at += 2) path.push_back({at[0], at[1]});
            if (cued) {
                past.ranges.assign(at, at + beams);
                at += beams;
                now.pose = {at[0], at[1], at[2]};
                past.pose = {at[3], at[4], at[5]};
                at += 6;
            }
            std::vector<Look> looks;
            for (std::size_t k = 0; k < followed; ++k, at += 3) {
                looks.push_back({{at, at + beams}, {}});
                at += beams;
                looks.back().pose = {at[0], at[1], at[2]};
            }
            const std::vector<float> tracks = policy.tracks(looks);
            const adrl::Twist velocity = policy.velocity(policy.act(now, past, tracks, goal, path, twist, last));
            std::printf("%.9g %.9g\n", velocity.v, velocity.w);
            std::fflush(stdout);
        }
        return 0;
    } catch (const std::exception &error) {
        std::cerr << "adrl_act: " << error.what() << "\n";
        return 1;
    }
}
