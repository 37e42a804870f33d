#pragma once

#include "geometry_msgs/msg/pose_stamped.hpp"

namespace geometry_msgs::msg
{
struct Vector3
{
  double x = 0, y = 0, z = 0;
};
struct Twist
{
  Vector3 linear, angular;
};
struct TwistStamped
{
  std_msgs::msg::Header header;
  Twist twist;
};
}  // namespace geometry_msgs::msg
