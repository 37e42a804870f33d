// What the example takes of realtime_tools, with its signatures in Humble and in Jazzy.
#pragma once

#include "rclcpp/rclcpp.hpp"

namespace realtime_tools
{
template <class MessageT>
class RealtimePublisher
{
public:
  explicit RealtimePublisher(typename rclcpp::Publisher<MessageT>::SharedPtr publisher)
  : publisher_(publisher)
  {
  }
#if RCLCPP_VERSION_MAJOR >= 21
  bool try_publish(const MessageT & message) { return take(message); }
  [[deprecated("Use try_publish() method instead")]] bool tryPublish(const MessageT & message)
  {
    return take(message);
  }
#else
  bool tryPublish(const MessageT & message) { return take(message); }
#endif

private:
  // Now and then its thread has hold of the message.
  bool take(const MessageT & message)
  {
    if (++calls_ % 3 == 1) { return false; }
    publisher_->publish(message);
    return true;
  }

  typename rclcpp::Publisher<MessageT>::SharedPtr publisher_;
  int calls_ = 0;
};
}  // namespace realtime_tools
