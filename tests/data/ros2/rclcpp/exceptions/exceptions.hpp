// Stand-in for rclcpp: the exceptions that the generated plugin and the interface name.
#pragma once

#include <stdexcept>

namespace rclcpp::exceptions {

struct InvalidParameterValueException : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct ParameterUninitializedException : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace rclcpp::exceptions
