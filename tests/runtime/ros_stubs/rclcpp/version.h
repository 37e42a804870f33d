// 16 is Humble, 28 Jazzy.
#ifndef RCLCPP_VERSION_MAJOR
#define RCLCPP_VERSION_MAJOR 28
#endif
