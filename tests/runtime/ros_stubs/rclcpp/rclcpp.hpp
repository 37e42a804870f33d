// What the example takes of rclcpp, with its signatures; one process, no middleware.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "rclcpp/version.h"

namespace builtin_interfaces::msg
{
struct Time
{
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
};
}  // namespace builtin_interfaces::msg

namespace rclcpp
{
class Time
{
public:
  explicit Time(std::int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
  operator builtin_interfaces::msg::Time() const
  {
    return {
      static_cast<std::int32_t>(nanoseconds_ / 1000000000),
      static_cast<std::uint32_t>(nanoseconds_ % 1000000000)};
  }

private:
  std::int64_t nanoseconds_;
};

class Duration
{
public:
  static Duration from_seconds(double seconds) { return Duration(seconds); }
  double seconds() const { return seconds_; }

private:
  explicit Duration(double seconds) : seconds_(seconds) {}
  double seconds_;
};

class Clock
{
public:
  using SharedPtr = std::shared_ptr<Clock>;
};

class Logger
{
};

// As of now all that was logged.
inline int logged = 0;

class QoS
{
public:
  explicit QoS(std::size_t) {}
  QoS & transient_local() { return *this; }
};

class SensorDataQoS : public QoS
{
public:
  SensorDataQoS() : QoS(5) {}
};

class SystemDefaultsQoS : public QoS
{
public:
  SystemDefaultsQoS() : QoS(10) {}
};

class TimerBase
{
public:
  using SharedPtr = std::shared_ptr<TimerBase>;
  explicit TimerBase(std::function<void()> callback) : callback_(std::move(callback)) {}
  void execute_callback() { callback_(); }

private:
  std::function<void()> callback_;
};

template <typename CallbackT>
class WallTimer : public TimerBase
{
public:
  using SharedPtr = std::shared_ptr<WallTimer>;
  using TimerBase::TimerBase;
};

// The last message stands in `last`.
template <typename MessageT>
class Publisher
{
public:
  using SharedPtr = std::shared_ptr<Publisher>;
  virtual ~Publisher() = default;
  void publish(const MessageT & message)
  {
    last = message;
    ++count;
  }
  MessageT last;
  int count = 0;
};

template <typename MessageT>
class Subscription
{
public:
  using SharedPtr = std::shared_ptr<Subscription>;
  explicit Subscription(std::function<void(std::shared_ptr<const MessageT>)> callback)
  : callback_(std::move(callback))
  {
  }
  void handle(const MessageT & message) { callback_(std::make_shared<const MessageT>(message)); }

private:
  std::function<void(std::shared_ptr<const MessageT>)> callback_;
};

using ParameterValue =
  std::variant<bool, std::int64_t, double, std::string, std::vector<std::string>>;

class Parameter
{
public:
  explicit Parameter(ParameterValue value) : value_(std::move(value)) {}
  template <typename T>
  T get_value() const
  {
    if (!std::holds_alternative<T>(value_)) { throw std::runtime_error("parameter has another type"); }
    return std::get<T>(value_);
  }

private:
  ParameterValue value_;
};

namespace node_interfaces
{
class NodeBaseInterface
{
public:
  using SharedPtr = std::shared_ptr<NodeBaseInterface>;
};
}  // namespace node_interfaces

inline void init(int, char **) {}
inline void shutdown() {}
// The test's.
void spin(node_interfaces::NodeBaseInterface::SharedPtr);

inline void check_log(const Logger &, const char * format, ...) __attribute__((format(printf, 2, 3)));
inline void check_log(const Logger &, const char *, ...) { ++logged; }
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) rclcpp::check_log(logger, __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) rclcpp::check_log(logger, __VA_ARGS__)
#define RCLCPP_WARN_THROTTLE(logger, clock, duration, ...) \
  (static_cast<void>(static_cast<rclcpp::Clock &>(clock)), static_cast<void>(duration), \
   rclcpp::check_log(logger, __VA_ARGS__))
