// A lifecycle node: measured poses and goals in, commanded poses and twists out, from a timer.
#include <chrono>
#include <exception>
#include <memory>

#include "loop.hpp"

namespace noslip_ros
{
class Node : public rclcpp_lifecycle::LifecycleNode
{
public:
  Node() : rclcpp_lifecycle::LifecycleNode("noslip"), loop_(*this, 0.002) {}

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    try {
      loop_.configure(*this, 0.002);
    } catch (const std::exception & error) {
      RCLCPP_ERROR(get_logger(), "%s", error.what());
      return CallbackReturn::FAILURE;
    }
    pose_ = create_publisher<geometry_msgs::msg::PoseStamped>("~/commanded_pose", rclcpp::QoS(1));
    twist_ = create_publisher<geometry_msgs::msg::TwistStamped>("~/commanded_twist", rclcpp::QoS(1));
    status_ = create_publisher<diagnostic_msgs::msg::DiagnosticStatus>(
      "~/status", rclcpp::QoS(1).transient_local());
    measured_from_ = create_subscription<geometry_msgs::msg::PoseStamped>(
      "~/measured_pose", rclcpp::SensorDataQoS(),
      [this](const geometry_msgs::msg::PoseStamped::ConstSharedPtr message) {
        take(*message, measured_);
      });
    goal_from_ = create_subscription<geometry_msgs::msg::PoseStamped>(
      "~/goal_pose", rclcpp::QoS(1),
      [this](const geometry_msgs::msg::PoseStamped::ConstSharedPtr message) { take(*message, goal_); });
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State & state) override
  {
    if (const char * why_not = loop_.begin(measured_)) {
      RCLCPP_ERROR(get_logger(), "not activated: %s", why_not);
      return CallbackReturn::FAILURE;
    }
    measured_ = goal_ = kNoPose;
    last_ = std::chrono::steady_clock::now();
    const std::chrono::duration<double> period(loop_.time_step());
    timer_ = create_wall_timer(
      std::chrono::duration_cast<std::chrono::nanoseconds>(period), [this]() { cycle(); });
    const auto activated = rclcpp_lifecycle::LifecycleNode::on_activate(state);
    status_->publish(loop_.status);
    return activated;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State & state) override
  {
    timer_.reset();
    // Who follows twists must not go on.
    geometry_msgs::msg::TwistStamped rest;
    rest.header.frame_id = loop_.twist.header.frame_id;
    rest.header.stamp = now();
    twist_->publish(rest);
    measured_ = kNoPose;
    return rclcpp_lifecycle::LifecycleNode::on_deactivate(state);
  }

  CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) override
  {
    measured_from_.reset();
    goal_from_.reset();
    pose_.reset();
    twist_.reset();
    status_.reset();
    return CallbackReturn::SUCCESS;
  }

private:
  void take(const geometry_msgs::msg::PoseStamped & message, Pose & into)
  {
    if (!loop_.is_in_frame(message.header.frame_id)) {
      RCLCPP_WARN_THROTTLE(
        get_logger(), *get_clock(), 1000, "a pose in frame %s is not taken: frame_id is %s",
        message.header.frame_id.c_str(), loop_.pose.header.frame_id.c_str());
      return;
    }
    into = pose_of(message.pose);
  }

  void cycle()
  {
    const auto at = std::chrono::steady_clock::now();
    const double elapsed = std::chrono::duration<double>(at - last_).count();
    last_ = at;
    loop_.step(elapsed, measured_, goal_);
    // Each is one sample; the controller remembers the goal.
    measured_ = goal_ = kNoPose;
    const bool is_new = loop_.tell(now());
    pose_->publish(loop_.pose);
    twist_->publish(loop_.twist);
    if (is_new) { status_->publish(loop_.status); }
  }

  Loop loop_;
  Pose measured_ = kNoPose, goal_ = kNoPose;
  std::chrono::steady_clock::time_point last_;
  rclcpp::TimerBase::SharedPtr timer_;
  rclcpp::Subscription<geometry_msgs::msg::PoseStamped>::SharedPtr measured_from_, goal_from_;
  rclcpp_lifecycle::LifecyclePublisher<geometry_msgs::msg::PoseStamped>::SharedPtr pose_;
  rclcpp_lifecycle::LifecyclePublisher<geometry_msgs::msg::TwistStamped>::SharedPtr twist_;
  rclcpp_lifecycle::LifecyclePublisher<diagnostic_msgs::msg::DiagnosticStatus>::SharedPtr status_;
};

}  // namespace noslip_ros

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  const auto node = std::make_shared<noslip_ros::Node>();
  rclcpp::spin(node->get_node_base_interface());
  rclcpp::shutdown();
  return 0;
}
