// A robot that follows late; its sensor is slow and noisy.
#pragma once

#include <array>
#include <cmath>
#include <random>

using Pose = std::array<double, 7>;

class Robot
{
public:
  explicit Robot(const Pose & at) : tool(at) {}

  void follow(const Pose & command, double seconds)
  {
    const double share = 1 - std::exp(-seconds / 0.03);
    double along = 0, size = 0;
    for (std::size_t i = 3; i < 7; ++i) { along += command[i] * tool[i]; }
    for (std::size_t i = 0; i < 7; ++i) {
      tool[i] += share * ((i >= 3 && along < 0 ? -command[i] : command[i]) - tool[i]);
      if (i >= 3) { size += tool[i] * tool[i]; }
    }
    for (std::size_t i = 3; i < 7; ++i) { tool[i] /= std::sqrt(size); }
  }

  Pose measured()
  {
    Pose seen = tool;
    for (std::size_t i = 0; i < 3; ++i) { seen[i] += 1e-4 * normal_(random_); }
    return seen;
  }

  Pose tool;

private:
  std::mt19937 random_{3};
  std::normal_distribution<double> normal_;
};

inline double apart(const Pose & one, const Pose & other)
{
  return std::hypot(one[0] - other[0], one[1] - other[1], one[2] - other[2]);
}
