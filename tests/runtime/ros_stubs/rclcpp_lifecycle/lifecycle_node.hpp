// What the example takes of rclcpp_lifecycle, with its signatures.
#pragma once

#include <any>
#include <type_traits>

#include "rclcpp/rclcpp.hpp"

namespace rclcpp_lifecycle
{
class State
{
};

namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_cleanup(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_shutdown(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_error(const State &) { return CallbackReturn::FAILURE; }
};
}  // namespace node_interfaces

class ManagedEntity
{
public:
  virtual ~ManagedEntity() = default;
  bool is_activated = false;
};

template <typename MessageT>
class LifecyclePublisher : public ManagedEntity, public rclcpp::Publisher<MessageT>
{
public:
  using SharedPtr = std::shared_ptr<LifecyclePublisher>;
  virtual void publish(const MessageT & message)
  {
    if (is_activated) { rclcpp::Publisher<MessageT>::publish(message); }
  }
};

class LifecycleNode : public node_interfaces::LifecycleNodeInterface
{
public:
  explicit LifecycleNode(const std::string & name) : name_(name) { latest = this; }

  const char * get_name() const { return name_.c_str(); }
  rclcpp::Logger get_logger() const { return {}; }
  rclcpp::Clock::SharedPtr get_clock() { return clock_; }
  rclcpp::Time now() const { return rclcpp::Time(0); }
  rclcpp::node_interfaces::NodeBaseInterface::SharedPtr get_node_base_interface() { return nullptr; }

  CallbackReturn on_activate(const State &) override { return activate(true); }
  CallbackReturn on_deactivate(const State &) override { return activate(false); }

  bool has_parameter(const std::string & name) const { return parameters.count(name) > 0; }
  rclcpp::Parameter get_parameter(const std::string & name) const
  {
    return rclcpp::Parameter(parameters.at(name));
  }
  template <typename T>
  T declare_parameter(const std::string & name, const T & usual)
  {
    if (has_parameter(name)) { throw std::runtime_error(name + " is declared already"); }
    const auto given = overrides.find(name);
    parameters[name] = given == overrides.end() ? rclcpp::ParameterValue(usual) : given->second;
    return get_parameter(name).get_value<T>();
  }

  template <typename MessageT>
  std::shared_ptr<LifecyclePublisher<MessageT>> create_publisher(
    const std::string & topic, const rclcpp::QoS &)
  {
    const auto publisher = std::make_shared<LifecyclePublisher<MessageT>>();
    managed_.push_back(publisher);
    topics[topic] = publisher;
    return publisher;
  }

  template <typename MessageT, typename CallbackT>
  std::shared_ptr<rclcpp::Subscription<MessageT>> create_subscription(
    const std::string & topic, const rclcpp::QoS &, CallbackT && callback)
  {
    const auto subscription =
      std::make_shared<rclcpp::Subscription<MessageT>>(std::forward<CallbackT>(callback));
    topics[topic] = subscription;
    return subscription;
  }

  template <typename RepT, typename PeriodT, typename CallbackT>
  typename rclcpp::WallTimer<CallbackT>::SharedPtr create_wall_timer(
    std::chrono::duration<RepT, PeriodT>, CallbackT callback)
  {
    const auto made = std::make_shared<rclcpp::WallTimer<CallbackT>>(callback);
    timer = made;
    return made;
  }

  // What a test looks at and sets.
  std::map<std::string, rclcpp::ParameterValue> parameters;
  inline static std::map<std::string, rclcpp::ParameterValue> overrides;
  inline static LifecycleNode * latest = nullptr;
  std::map<std::string, std::any> topics;
  std::weak_ptr<rclcpp::TimerBase> timer;

  template <typename MessageT>
  LifecyclePublisher<MessageT> & publisher(const std::string & topic)
  {
    return *std::any_cast<std::shared_ptr<LifecyclePublisher<MessageT>>>(topics.at(topic));
  }
  template <typename MessageT>
  rclcpp::Subscription<MessageT> & subscription(const std::string & topic)
  {
    return *std::any_cast<std::shared_ptr<rclcpp::Subscription<MessageT>>>(topics.at(topic));
  }

private:
  CallbackReturn activate(bool is)
  {
    for (const auto & entity : managed_) { entity->is_activated = is; }
    return CallbackReturn::SUCCESS;
  }

  std::string name_;
  rclcpp::Clock::SharedPtr clock_ = std::make_shared<rclcpp::Clock>();
  std::vector<std::shared_ptr<ManagedEntity>> managed_;
};
}  // namespace rclcpp_lifecycle
