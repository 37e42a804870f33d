// What the example takes of realtime_tools, with its signatures.
#pragma once

namespace realtime_tools
{
template <class T>
class RealtimeBuffer
{
public:
  T * readFromRT() { return &data_; }
  void writeFromNonRT(const T & data) { data_ = data; }

private:
  T data_{};
};
}  // namespace realtime_tools
