// A robot that is not where it is told to be: it follows late, its sensor is slow, noisy and biased, it is
// pushed, and the goal moves while it is on its way.  Writes, a hundred times a second, what is commanded
// and where the tool is; the last line says what became of it.  Ends with 0 if the tool is at its goal.
#include "@NAME@.h"
#include "controller.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <random>

namespace example {

using Pose = std::array<double, 7>;  // x, y, z (m), then w, x, y, z

constexpr double length = @LENGTH@;  // of the primitive's path, m
constexpr double cycle = 0.001;      // s
constexpr int print_every = 10;      // cycles
constexpr long afterwards = 300;     // cycles: the command is held, and the tool catches up with it
constexpr double close_enough = 4e-3 * length;
constexpr std::array<double, 3> goal_step{@ASIDE@};

// First-order lag behind a delay.  The sensor tells a pose now and then.
class Robot {
public:
    explicit Robot(const Pose &at) : tool(at), commands_(delay, at) {}

    void follow(const Pose &command) {
        commands_.push_back(command);
        const Pose wanted = commands_.front();
        commands_.pop_front();
        double along = 0, size = 0;
        for (std::size_t i = 3; i < 7; ++i) along += wanted[i] * tool[i];
        for (std::size_t i = 0; i < 7; ++i) {
            const double sign = i >= 3 && along < 0 ? -1 : 1;
            tool[i] += share_ * (sign * wanted[i] - tool[i]);
            if (i >= 3) size += tool[i] * tool[i];
        }
        for (std::size_t i = 3; i < 7; ++i) tool[i] /= std::sqrt(size);
    }

    void push(const std::array<double, 3> &by) {
        for (std::size_t i = 0; i < 3; ++i) tool[i] += by[i];
    }

    Pose measured() {
        Pose seen = tool;
        for (std::size_t i = 0; i < 3; ++i) seen[i] += noise * normal_(random_) + bias / std::sqrt(3.0);
        for (std::size_t i = 3; i < 7; ++i) seen[i] += 0.5 * angle_noise * normal_(random_);
        return seen;
    }

    Pose tool;

private:
    static constexpr double lag = 0.04;             // s
    static constexpr std::size_t delay = 10;        // cycles
    static constexpr double noise = 5e-4 * length;  // standard deviations, m and rad
    static constexpr double angle_noise = 0.003;
    static constexpr double bias = 0.01 * length;

    const double share_ = 1 - std::exp(-cycle / lag);
    std::deque<Pose> commands_;
    std::mt19937 random_{7};
    std::normal_distribution<double> normal_;
};

static Pose command_of(const noslip_state &state) {
    Pose pose;
    std::copy_n(state.position, 3, pose.begin());
    std::copy_n(state.quaternion, 4, pose.begin() + 3);
    return pose;
}

static double apart(const Pose &pose, const std::array<double, 3> &point) {
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) sum += (pose[i] - point[i]) * (pose[i] - point[i]);
    return std::sqrt(sum);
}

static noslip_controller controller;  // a megabyte or so: not on the stack

static int run() {
    noslip_controller_init(&controller, &::@NAME@, cycle);
    if (noslip_controller_start(&controller, nullptr) != 0) return 1;
    Robot robot(command_of(controller.state));

    const double duration = ::@NAME@.duration;
    const long push_at = std::lround(0.3 * duration / cycle), step_at = std::lround(0.5 * duration / cycle);
    const long most = std::lround(10 * duration / cycle);
    std::array<double, 3> goal{};
    std::copy_n(::@NAME@.goal_position, 3, goal.begin());

    std::printf("t,x,y,z,qw,qx,qy,qz,tool_x,tool_y,tool_z,speed,mode\n");
    long done_at = most;
    for (long k = 0; k < std::min(done_at + afterwards, most); ++k) {
        if (k == push_at) robot.push({0.02 * length, 0.02 * length, 0});
        if (k == step_at) {
            for (std::size_t i = 0; i < 3; ++i) goal[i] += goal_step[i];
        }
        const bool is_seen = k % 16 == 0;  // some 60 Hz
        const Pose seen = is_seen ? robot.measured() : Pose{};
        noslip_controller_step(&controller, cycle, is_seen ? seen.data() : nullptr, goal.data(), nullptr);
        const Pose command = command_of(controller.state);
        robot.follow(command);
        if (k > step_at && done_at == most && noslip_controller_done(&controller) != 0) done_at = k + 1;
        if (k % print_every == 0) {
            std::printf("%.6g", static_cast<double>(k + 1) * cycle);
            for (const double number : command) std::printf(",%.17g", number);
            for (std::size_t i = 0; i < 3; ++i) std::printf(",%.17g", robot.tool[i]);
            std::printf(",%.6g,%d\n", controller.speed, static_cast<int>(controller.mode));
        }
    }

    const double left = apart(robot.tool, goal), took = static_cast<double>(done_at) * cycle;
    const bool is_there = done_at < most && left <= close_enough;
    std::printf("# %s after %.3g s, %.3g times its own duration, with %d plans (%d not found): the tool is "
                "%.2g m from its goal, %.2g of the path\n",
                is_there ? "done" : "NOT at its goal", took, took / duration, controller.plans,
                controller.failures, left, left / length);
    return is_there ? 0 : 1;
}

}  // namespace example

int main() { return example::run(); }
