// Runs the node as an executor does, against a robot.  Prints what a test asserts.
#include <chrono>
#include <cstdlib>
#include <thread>

#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"
#include "robot.hpp"

using CallbackReturn = rclcpp_lifecycle::LifecycleNode::CallbackReturn;
using geometry_msgs::msg::PoseStamped;
using geometry_msgs::msg::TwistStamped;
using diagnostic_msgs::msg::DiagnosticStatus;

static Pose pose_of(const PoseStamped & message)
{
  const auto & p = message.pose.position;
  const auto & q = message.pose.orientation;
  return {p.x, p.y, p.z, q.x, q.y, q.z, q.w};
}

static PoseStamped message_of(const Pose & pose)
{
  PoseStamped message;
  message.pose.position = {pose[0], pose[1], pose[2]};
  message.pose.orientation = {pose[3], pose[4], pose[5], pose[6]};
  return message;
}

static void drive(rclcpp_lifecycle::LifecycleNode & node)
{
  const rclcpp_lifecycle::State state;
  if (node.on_configure(state) != CallbackReturn::SUCCESS) { std::exit(2); }
  // Nothing is measured yet.
  if (node.on_activate(state) != CallbackReturn::FAILURE) { std::exit(3); }
  const char * start = std::getenv("START");
  Pose at{};
  for (double & number : at) {
    char * rest = nullptr;
    number = std::strtod(start, &rest);
    start = rest;
  }
  Robot robot(at);
  auto & measured = node.subscription<PoseStamped>("~/measured_pose");
  PoseStamped elsewhere = message_of(at);
  elsewhere.header.frame_id = "another";
  measured.handle(elsewhere);
  if (node.on_activate(state) != CallbackReturn::FAILURE) { std::exit(4); }
  measured.handle(message_of(at));
  if (node.on_activate(state) != CallbackReturn::SUCCESS) { std::exit(5); }

  const auto & command = node.publisher<PoseStamped>("~/commanded_pose");
  const auto & twist = node.publisher<TwistStamped>("~/commanded_twist");
  const auto & status = node.publisher<DiagnosticStatus>("~/status");
  double seconds = 0, fastest = 0;
  auto last = std::chrono::steady_clock::now();
  int k = 0;
  for (; seconds < 20 && status.last.values[2].value != "true"; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    if (k % 5 == 0) { measured.handle(message_of(robot.measured())); }
    node.timer.lock()->execute_callback();
    const auto now = std::chrono::steady_clock::now();
    const double passed = std::chrono::duration<double>(now - last).count();
    last = now;
    seconds += passed;
    robot.follow(pose_of(command.last), passed);
    fastest = std::max(fastest, std::abs(twist.last.twist.linear.x));
  }
  for (int i = 0; i < 200; ++i) { robot.follow(pose_of(command.last), 0.002); }
  const Pose & tool = robot.tool;
  std::printf("tool %.9g %.9g %.9g\ncycles %d\npublished %d\nfastest %g\nstatus %s\n", tool[0], tool[1],
              tool[2], k, command.count, fastest, status.last.message.c_str());
  if (node.on_deactivate(state) != CallbackReturn::SUCCESS || !node.timer.expired()) { std::exit(6); }
  std::printf("at rest %d\n", twist.count == k + 1 && twist.last.twist.linear.x == 0);
  if (node.on_cleanup(state) != CallbackReturn::SUCCESS) { std::exit(7); }
  if (node.on_configure(state) != CallbackReturn::SUCCESS) { std::exit(8); }
}

void rclcpp::spin(rclcpp::node_interfaces::NodeBaseInterface::SharedPtr)
{
  drive(*rclcpp_lifecycle::LifecycleNode::latest);
}
