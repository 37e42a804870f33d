// What the example takes of controller_interface, with its signatures in Humble and in Jazzy.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "hardware_interface/handle.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

namespace controller_interface
{
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;

enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };

enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names = {};
};

class ControllerInterfaceBase : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface
{
public:
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;

  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
#if RCLCPP_VERSION_MAJOR >= 21
  std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
#else
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
#endif
  unsigned int get_update_rate() const { return update_rate; }

  void assign_interfaces(
    std::vector<hardware_interface::LoanedCommandInterface> && commands,
    std::vector<hardware_interface::LoanedStateInterface> && states)
  {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }

  unsigned int update_rate = 0;

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ =
    std::make_shared<rclcpp_lifecycle::LifecycleNode>("a_controller");
};

class ChainableControllerInterface : public ControllerInterfaceBase
{
public:
  return_type update(const rclcpp::Time & time, const rclcpp::Duration & period)
  {
    if (!is_chained) {
#if RCLCPP_VERSION_MAJOR >= 21
      const return_type taken = update_reference_from_subscribers(time, period);
#else
      const return_type taken = update_reference_from_subscribers();
#endif
      if (taken != return_type::OK) { return taken; }
    }
    return update_and_write_commands(time, period);
  }

  std::vector<hardware_interface::CommandInterface> export_reference_interfaces()
  {
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
    auto references = on_export_reference_interfaces();
#pragma GCC diagnostic pop
    if (reference_interfaces_.size() != references.size()) {
      throw std::runtime_error("reference_interfaces_ has another size");
    }
    for (const auto & interface : references) {
      if (interface.get_prefix_name() != get_node()->get_name()) {
        throw std::runtime_error(interface.get_name() + " does not begin with the controller's name");
      }
    }
    return references;
  }

  bool is_chained = false;

protected:
#if RCLCPP_VERSION_MAJOR >= 21
  [[deprecated("Replaced by on_export_reference_interfaces_list() method.")]]
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() { return {}; }
  virtual return_type update_reference_from_subscribers(
    const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
#else
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
  virtual return_type update_reference_from_subscribers() = 0;
#endif
  virtual return_type update_and_write_commands(
    const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

  std::vector<double> reference_interfaces_;
};
}  // namespace controller_interface
