// Stand-in for rclcpp: warnings go to standard error.
#pragma once

#include <cstdio>
#include <string>

namespace rclcpp {

struct Logger {
  std::string name;
};

inline Logger get_logger(const std::string& name) { return {name}; }

}  // namespace rclcpp

#define RCLCPP_WARN(logger, ...)                                \
  do {                                                          \
    std::fprintf(stderr, "[WARN] [%s] ", (logger).name.c_str()); \
    std::fprintf(stderr, __VA_ARGS__);                          \
    std::fputc('\n', stderr);                                   \
  } while (false)
