// What the example takes of hardware_interface, with its signatures in Humble and in Jazzy.
#pragma once

#include <optional>
#include <string>

#include "rclcpp/version.h"

namespace hardware_interface
{
class Handle
{
public:
#if RCLCPP_VERSION_MAJOR >= 21
  [[deprecated("Use InterfaceDescription for initializing the Interface")]]
#endif
  Handle(const std::string & prefix_name, const std::string & interface_name, double * value_ptr)
  : prefix_name_(prefix_name), interface_name_(interface_name), value_ptr_(value_ptr)
  {
  }
  std::string get_name() const { return prefix_name_ + "/" + interface_name_; }
  const std::string & get_prefix_name() const { return prefix_name_; }
  double & value() const { return *value_ptr_; }

private:
  std::string prefix_name_, interface_name_;
  double * value_ptr_;
};

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
class StateInterface : public Handle
{
public:
  using Handle::Handle;
};

class CommandInterface : public Handle
{
public:
  CommandInterface(const CommandInterface &) = delete;
  CommandInterface(CommandInterface &&) = default;
  using Handle::Handle;
};
#pragma GCC diagnostic pop

template <typename InterfaceT>
class Loaned
{
public:
  explicit Loaned(InterfaceT & interface) : interface_(interface) {}
  Loaned(const Loaned &) = delete;
  Loaned(Loaned &&) = default;

#if RCLCPP_VERSION_MAJOR >= 21
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int = 10) const
  {
    return interface_.value();
  }
  [[deprecated("Use std::optional<T> get_optional() instead")]] double get_value() const
  {
    return interface_.value();
  }
#else
  double get_value() const { return interface_.value(); }
#endif

protected:
  InterfaceT & interface_;
};

class LoanedStateInterface : public Loaned<StateInterface>
{
public:
  using Loaned::Loaned;
};

class LoanedCommandInterface : public Loaned<CommandInterface>
{
public:
  using Loaned::Loaned;
#if RCLCPP_VERSION_MAJOR >= 21
  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int = 10)
  {
    interface_.value() = value;
    return true;
  }
#else
  void set_value(double value) { interface_.value() = value; }
#endif
};
}  // namespace hardware_interface
