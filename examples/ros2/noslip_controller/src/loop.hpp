// The exported controller with ROS around it: parameters, poses, words.  What node and controller share.
#ifndef NOSLIP_CONTROLLER__LOOP_HPP_
#define NOSLIP_CONTROLLER__LOOP_HPP_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

#include "controller.h"
#include "primitive.h"

namespace noslip_ros
{
using Pose = std::array<double, 7>;  // as ROS has it: x, y, z (m), then x, y, z, w

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
constexpr Pose kNoPose{kNothing, kNothing, kNothing, kNothing, kNothing, kNothing, kNothing};

inline bool is_finite(const double * numbers, std::size_t count)
{
  return std::all_of(numbers, numbers + count, [](double number) { return std::isfinite(number); });
}

inline bool has_position(const Pose & pose) { return is_finite(pose.data(), 3); }

// Of unit length, nearly: the quaternion of an empty message is none.
inline bool has_orientation(const Pose & pose)
{
  double size = 0;
  for (std::size_t i = 3; i < 7; ++i) { size += pose[i] * pose[i]; }
  return std::abs(size - 1) < 0.02;
}

inline Pose pose_of(const geometry_msgs::msg::Pose & pose)
{
  const auto & p = pose.position;
  const auto & q = pose.orientation;
  return {p.x, p.y, p.z, q.x, q.y, q.z, q.w};
}

// noslip puts w first.
inline std::array<double, 4> w_first(const Pose & pose) { return {pose[6], pose[3], pose[4], pose[5]}; }

inline const char * word(noslip_mode mode)
{
  switch (mode) {
    case NOSLIP_MODE_TRACK: return "track";
    case NOSLIP_MODE_YIELD: return "yield";
    case NOSLIP_MODE_HOLD: return "hold";
    case NOSLIP_MODE_FAULT: break;
  }
  return "fault";
}

inline const char * word(noslip_reason reason)
{
  switch (reason) {
    case NOSLIP_REASON_NONE: return "";
    case NOSLIP_REASON_FAULT: return "fault";
    case NOSLIP_REASON_BLOCKED: return "blocked";
    case NOSLIP_REASON_SILENT: return "silent";
    case NOSLIP_REASON_HELD: return "held";
    case NOSLIP_REASON_NO_PLAN: return "no plan";
    case NOSLIP_REASON_PAUSED: return "paused";
    case NOSLIP_REASON_WAITS: break;
  }
  return "waits";
}

template <typename T>
T parameter(rclcpp_lifecycle::LifecycleNode & node, const std::string & name, const T & usual)
{
  if (!node.has_parameter(name)) { return node.declare_parameter<T>(name, usual); }
  return node.get_parameter(name).get_value<T>();
}

// Its messages are members, and no word is longer than a string holds in itself: once it is configured
// it allocates nothing.
class Loop
{
public:
  // Set what is usual, or what the node's parameters say; a time step of 0 is to be told in configure.
  // Throws where a parameter is of another type.
  Loop(rclcpp_lifecycle::LifecycleNode & node, double time_step) : usual_step_(time_step)
  {
    read(node);
  }
  Loop(const Loop &) = delete;
  Loop & operator=(const Loop &) = delete;

  // Read the parameters anew, and go to the start; `time_step` (s) where none is set.  Throws
  // std::invalid_argument if one is not what it must be.
  void configure(rclcpp_lifecycle::LifecycleNode & node, double time_step)
  {
    read(node);
    if (c_->time_step <= 0) { c_->time_step = time_step; }
    if (noslip_controller_start(c_.get(), nullptr) != 0) {
      throw std::invalid_argument(
        "noslip does not start: time_step, tolerance, angle_tolerance and faster must be positive, bias, "
        "plan_within and braking not negative, knots at most " +
        std::to_string(NOSLIP_CONTROLLER_KNOTS));
    }
    status.name = node.get_name();
    status.values.resize(4);
    const char * keys[] = {"mode", "reason", "done", "plans"};
    for (std::size_t i = 0; i < status.values.size(); ++i) { status.values[i].key = keys[i]; }
    tell(node.now());
  }

  // Begin from the start, where the tool must be; else why not.
  const char * begin(const Pose & measured)
  {
    if (noslip_controller_start(c_.get(), nullptr) != 0) { return "it does not start"; }
    if (!has_position(measured) || !has_orientation(measured)) { return "no pose is measured"; }
    const Pose start = command();
    double off = 0, along = 0;
    for (std::size_t i = 0; i < 7; ++i) {
      if (i < 3) { off += (measured[i] - start[i]) * (measured[i] - start[i]); }
      if (i >= 3) { along += measured[i] * start[i]; }
    }
    if (std::sqrt(off) > start_within_) { return "the tool is away from the start (start_within)"; }
    if (2 * std::acos(std::min(1.0, std::abs(along))) > start_angle_within_) {
      return "the tool is turned away from the start (start_angle_within)";
    }
    return nullptr;
  }

  // A cycle of so many seconds.  What is not finite was not measured, or is not asked for.
  void step(double seconds, const Pose & measured, const Pose & goal)
  {
    const auto turned = w_first(measured), wanted = w_first(goal);
    const double seen[7] = {
      measured[0], measured[1], measured[2], turned[0], turned[1], turned[2], turned[3]};
    const bool is_seen = has_position(measured) && has_orientation(measured);
    noslip_controller_step(
      c_.get(), seconds > 0 ? seconds : c_->time_step, is_seen ? seen : nullptr,
      has_position(goal) ? goal.data() : nullptr, has_orientation(goal) ? wanted.data() : nullptr);
  }

  // Put what is commanded into the messages; whether the status is another one than before.
  bool tell(const rclcpp::Time & now)
  {
    const Pose at = command();
    pose.header.stamp = twist.header.stamp = now;
    pose.pose.position.x = at[0];
    pose.pose.position.y = at[1];
    pose.pose.position.z = at[2];
    pose.pose.orientation.x = at[3];
    pose.pose.orientation.y = at[4];
    pose.pose.orientation.z = at[5];
    pose.pose.orientation.w = at[6];
    twist.twist.linear.x = c_->twist[0];
    twist.twist.linear.y = c_->twist[1];
    twist.twist.linear.z = c_->twist[2];
    twist.twist.angular.x = c_->twist[3];
    twist.twist.angular.y = c_->twist[4];
    twist.twist.angular.z = c_->twist[5];
    const noslip_reason reason = noslip_controller_reason(c_.get());
    const Status is{c_->mode, reason, noslip_controller_done(c_.get()), c_->plans};
    if (is == told_) { return false; }
    told_ = is;
    using Level = diagnostic_msgs::msg::DiagnosticStatus;
    status.level = reason == NOSLIP_REASON_NONE    ? Level::OK
                   : reason == NOSLIP_REASON_FAULT ? Level::ERROR
                                                   : Level::WARN;
    status.message = reason == NOSLIP_REASON_NONE ? word(c_->mode) : word(reason);
    status.values[0].value = word(c_->mode);
    status.values[1].value = word(reason);
    status.values[2].value = is[2] != 0 ? "true" : "false";
    char count[12];
    std::snprintf(count, sizeof count, "%d", c_->plans);
    status.values[3].value = count;
    return true;
  }

  Pose command() const
  {
    const double * p = c_->state.position;
    const double * q = c_->state.quaternion;
    return {p[0], p[1], p[2], q[1], q[2], q[3], q[0]};
  }

  const double * commanded_twist() const { return c_->twist; }
  double time_step() const { return c_->time_step; }
  bool has_failed() const { return c_->mode == NOSLIP_MODE_FAULT; }
  bool is_in_frame(const std::string & frame) const { return frame.empty() || frame == frame_; }

  geometry_msgs::msg::PoseStamped pose;
  geometry_msgs::msg::TwistStamped twist;
  diagnostic_msgs::msg::DiagnosticStatus status;

private:
  using Status = std::array<int, 4>;

  void read(rclcpp_lifecycle::LifecycleNode & node)
  {
    noslip_controller & c = *c_;
    noslip_controller_init(&c, &primitive, 0.0);
    c.time_step = parameter(node, "time_step", usual_step_);
    c.follows = parameter(node, "follows", c.follows != 0);
    c.replans = parameter(node, "replans", c.replans != 0);
    c.real_time = parameter(node, "real_time", true);
    c.units = static_cast<int>(parameter<std::int64_t>(node, "units", c.units));
    c.lag = parameter(node, "lag", c.lag);
    c.tolerance = parameter(node, "tolerance", c.tolerance);
    c.angle_tolerance = parameter(node, "angle_tolerance", c.angle_tolerance);
    c.bias = parameter(node, "bias", c.bias);
    c.faster = parameter(node, "faster", c.faster);
    c.plan_within = parameter(node, "plan_within", c.plan_within);
    c.braking = parameter(node, "braking", c.braking);
    c.knots = static_cast<int>(parameter<std::int64_t>(node, "knots", c.knots));
    start_within_ = parameter(node, "start_within", 0.005);
    start_angle_within_ = parameter(node, "start_angle_within", 0.05);
    frame_ = parameter<std::string>(node, "frame_id", "base_link");
    pose.header.frame_id = twist.header.frame_id = frame_;
  }

  const double usual_step_;
  // Of a megabyte or so.
  const std::unique_ptr<noslip_controller> c_ = std::make_unique<noslip_controller>();
  double start_within_ = 0, start_angle_within_ = 0;
  std::string frame_;
  Status told_{-1, -1, -1, -1};
};

}  // namespace noslip_ros

#endif  // NOSLIP_CONTROLLER__LOOP_HPP_
