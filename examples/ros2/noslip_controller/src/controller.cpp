// A chainable ros2_control controller: the measured pose is its state interfaces, the goal its reference
// interfaces, pose and twist its command interfaces, of hardware or of the controller below.
#include <algorithm>
#include <chrono>
#include <exception>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "hardware_interface/handle.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/version.h"
#include "realtime_tools/realtime_buffer.hpp"
#include "realtime_tools/realtime_publisher.hpp"

#include "loop.hpp"

namespace noslip_ros
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;
using Names = std::vector<std::string>;

constexpr const char * kPose[] = {"position.x",    "position.y",    "position.z",   "orientation.x",
                                  "orientation.y", "orientation.z", "orientation.w"};
constexpr const char * kTwist[] = {"linear.x",  "linear.y",  "linear.z",
                                   "angular.x", "angular.y", "angular.z"};

// Humble has get_value() and tryPublish(), later distributions get_optional() and try_publish(): the
// first of two functions that exists is taken.
template <typename Interface>
auto value_of(const Interface & interface, int)
  -> decltype(static_cast<double>(interface.template get_optional<double>().value()))
{
  return interface.template get_optional<double>().value_or(kNothing);
}

template <typename Interface>
double value_of(const Interface & interface, long)
{
  return interface.get_value();
}

template <typename Publisher, typename Message>
auto publish(Publisher & publisher, const Message & message, int) -> decltype(publisher.try_publish(message))
{
  return publisher.try_publish(message);
}

template <typename Publisher, typename Message>
bool publish(Publisher & publisher, const Message & message, long)
{
  return publisher.tryPublish(message);
}

// Outside the loop: a publisher's thread may have hold of it for a moment.
template <typename Publisher, typename Message>
void publish_at_last(Publisher & publisher, const Message & message)
{
  for (int i = 0; i < 100 && !publish(publisher, message, 0); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

class Controller : public controller_interface::ChainableControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    try {
      loop_ = std::make_unique<Loop>(*get_node(), 0.0);
      read_names();
    } catch (const std::exception & error) {
      RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
      return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    return {controller_interface::interface_configuration_type::INDIVIDUAL, states_};
  }

  InterfaceConfiguration command_interface_configuration() const override
  {
    return {controller_interface::interface_configuration_type::INDIVIDUAL, commands_};
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    try {
      read_names();
      const unsigned int rate = get_update_rate();
      loop_->configure(*get_node(), rate > 0 ? 1.0 / rate : 0.0);
    } catch (const std::exception & error) {
      RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
      return CallbackReturn::FAILURE;
    }
    auto & node = *get_node();
    pose_ = std::make_unique<realtime_tools::RealtimePublisher<PoseStamped>>(
      node.create_publisher<PoseStamped>("~/commanded_pose", rclcpp::SystemDefaultsQoS()));
    twist_ = std::make_unique<realtime_tools::RealtimePublisher<TwistStamped>>(
      node.create_publisher<TwistStamped>("~/commanded_twist", rclcpp::SystemDefaultsQoS()));
    status_ = std::make_unique<realtime_tools::RealtimePublisher<DiagnosticStatus>>(
      node.create_publisher<DiagnosticStatus>("~/status", rclcpp::QoS(1).transient_local()));
    // Where the tool must be when it is activated; and what a message takes is allocated now.
    publish_at_last(*pose_, loop_->pose);
    publish_at_last(*twist_, loop_->twist);
    publish_at_last(*status_, loop_->status);
    goal_from_ = node.create_subscription<PoseStamped>(
      "~/goal_pose", rclcpp::QoS(1), [this](const PoseStamped::ConstSharedPtr message) {
        if (loop_->is_in_frame(message->header.frame_id)) {
          goal_.writeFromNonRT({pose_of(message->pose), ++goals_});
        } else {
          RCLCPP_WARN(
            get_node()->get_logger(), "a goal in frame %s is not taken: frame_id is %s",
            message->header.frame_id.c_str(), loop_->pose.header.frame_id.c_str());
        }
      });
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    if (const char * why_not = loop_->begin(measured())) {
      RCLCPP_ERROR(get_node()->get_logger(), "not activated: %s", why_not);
      return CallbackReturn::FAILURE;
    }
    last_ = kNoPose;
    since_ = 0;
    // Goals from before are over.
    std::fill(reference_interfaces_.begin(), reference_interfaces_.end(), kNothing);
    over_ = goal_.readFromRT()->count;
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    // Who follows twists must not go on.
    for (std::size_t i = 7; i < command_interfaces_.size(); ++i) { set(i, 0.0); }
    return CallbackReturn::SUCCESS;
  }

#if RCLCPP_VERSION_MAJOR >= 21  // after Humble
  return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) override
#else
  return_type update_reference_from_subscribers() override
#endif
  {
    const Goal * goal = goal_.readFromRT();
    if (goal->count != over_) {
      std::copy(goal->pose.begin(), goal->pose.end(), reference_interfaces_.begin());
    }
    return return_type::OK;
  }

  return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration & period) override
  {
    Pose goal;
    std::copy_n(reference_interfaces_.begin(), 7, goal.begin());
    loop_->step(period.seconds(), sample(period.seconds()), goal);
    const Pose command = loop_->command();
    for (std::size_t i = 0; i < command_interfaces_.size(); ++i) {
      set(i, i < 7 ? command[i] : loop_->commanded_twist()[i - 7]);
    }
    is_untold_ = loop_->tell(time) || is_untold_;
    publish(*pose_, loop_->pose, 0);
    publish(*twist_, loop_->twist, 0);
    if (is_untold_) { is_untold_ = !publish(*status_, loop_->status, 0); }
    return loop_->has_failed() ? return_type::ERROR : return_type::OK;
  }

protected:
  // Later distributions have on_export_reference_interfaces_list() too, and call both.
  std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override
  {
    reference_interfaces_.assign(7, kNothing);
    std::vector<hardware_interface::CommandInterface> references;
    references.reserve(7);
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"  // its other constructor is not in Humble
    for (std::size_t i = 0; i < 7; ++i) {
      references.push_back(hardware_interface::CommandInterface(
        get_node()->get_name(), kPose[i], &reference_interfaces_[i]));
    }
#pragma GCC diagnostic pop
    return references;
  }

private:
  using PoseStamped = geometry_msgs::msg::PoseStamped;
  using TwistStamped = geometry_msgs::msg::TwistStamped;
  using DiagnosticStatus = diagnostic_msgs::msg::DiagnosticStatus;

  struct Goal
  {
    Pose pose = kNoPose;
    unsigned int count = 0;
  };

  void read_names()
  {
    Names states, commands;
    for (const char * name : kPose) {
      states.push_back(std::string("tool/") + name);
      commands.push_back(std::string("tool/") + name);
    }
    for (const char * name : kTwist) { commands.push_back(std::string("tool/") + name); }
    states_ = parameter(*get_node(), "state_interfaces", states);
    commands_ = parameter(*get_node(), "command_interfaces", commands);
    rate_ = parameter(*get_node(), "measured_rate", 0.0);
    if (states_.size() != 7 || (commands_.size() != 7 && commands_.size() != 13)) {
      throw std::invalid_argument(
        "state_interfaces are 7 names (position x, y, z; orientation x, y, z, w), command_interfaces the "
        "same 7 or 13 (linear and angular x, y, z besides)");
    }
  }

  Pose measured() const
  {
    Pose pose;
    for (std::size_t i = 0; i < 7; ++i) { pose[i] = value_of(state_interfaces_[i], 0); }
    return pose;
  }

  // What was measured since the last cycle.  A state interface holds its value: of a sensor that is slower
  // than the loop it is a sample once it has changed, or at the sensor's rate.
  Pose sample(double seconds)
  {
    const Pose pose = measured();
    since_ += seconds;
    if (rate_ > 0 && pose == last_ && since_ < 1 / rate_) { return kNoPose; }
    since_ = 0;
    return last_ = pose;
  }

  // Void in Humble; later whether nobody else had hold of it, and the next cycle writes again.
  void set(std::size_t i, double value) { static_cast<void>(command_interfaces_[i].set_value(value)); }

  std::unique_ptr<Loop> loop_;
  Names states_, commands_;
  double rate_ = 0, since_ = 0;
  Pose last_ = kNoPose;
  bool is_untold_ = true;
  unsigned int goals_ = 0, over_ = 0;
  realtime_tools::RealtimeBuffer<Goal> goal_;
  rclcpp::Subscription<PoseStamped>::SharedPtr goal_from_;
  std::unique_ptr<realtime_tools::RealtimePublisher<PoseStamped>> pose_;
  std::unique_ptr<realtime_tools::RealtimePublisher<TwistStamped>> twist_;
  std::unique_ptr<realtime_tools::RealtimePublisher<DiagnosticStatus>> status_;
};

}  // namespace noslip_ros

PLUGINLIB_EXPORT_CLASS(noslip_ros::Controller, controller_interface::ChainableControllerInterface)
