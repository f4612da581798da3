// Stand-in for inverse_dynamics_solver: the names of its exceptions.
#pragma once

#include <stdexcept>

#include <rclcpp/exceptions/exceptions.hpp>

namespace inverse_dynamics_solver {

using rclcpp::exceptions::InvalidParameterValueException;
using rclcpp::exceptions::ParameterUninitializedException;

struct UninitializedException : std::runtime_error {
  UninitializedException() : std::runtime_error("initialize has not been called") {}
};

}  // namespace inverse_dynamics_solver
