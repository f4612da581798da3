// Stand-in for rclcpp: a parameter that throws if it is read as another type than it has.
#pragma once

#include <string>
#include <variant>
#include <vector>

namespace rclcpp {

class Parameter {
 public:
  using Value = std::variant<std::monostate, bool, double, std::string, std::vector<double>>;

  Parameter() = default;
  explicit Parameter(Value value) : value_(std::move(value)) {}

  bool as_bool() const { return std::get<bool>(value_); }
  std::string as_string() const { return std::get<std::string>(value_); }
  std::vector<double> as_double_array() const { return std::get<std::vector<double>>(value_); }

 private:
  Value value_;
};

}  // namespace rclcpp
