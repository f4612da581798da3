// Stand-in for pluginlib: classes are registered by the names of their types when the program starts.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>

namespace pluginlib_stand_in {

template <class Base>
std::map<std::string, std::function<std::unique_ptr<Base>()>>& makers() {
  static std::map<std::string, std::function<std::unique_ptr<Base>()>> all;
  return all;
}

template <class Derived, class Base>
struct Registration {
  explicit Registration(const char* name) {
    makers<Base>()[name] = [] { return std::unique_ptr<Base>(new Derived); };
  }
};

}  // namespace pluginlib_stand_in

#define PLUGINLIB_EXPORT_CLASS(Derived, Base) \
  static const pluginlib_stand_in::Registration<Derived, Base> pluginlib_registration(#Derived);
