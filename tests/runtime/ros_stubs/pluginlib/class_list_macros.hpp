// A plugin's factory has a name that a test can call.
#pragma once

#include <memory>

#define PLUGINLIB_EXPORT_CLASS(class_type, base_class_type) \
  std::unique_ptr<base_class_type> make_plugin() { return std::make_unique<class_type>(); }
