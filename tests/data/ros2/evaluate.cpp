// Loads a plugin by name, evaluates it along a motion, counts its allocations and times its calls.
//
//   evaluate PLUGIN JOINTS PARAMETERS STATES RESULTS
//
// PARAMETERS has a line `NAME TYPE VALUE…` for each parameter of the node; the namespace is "ids". STATES holds q, dq
// and ddq of each sample. RESULTS receives M, C dq, gravity, friction and torque of each sample, then the same from
// getDynamicParameters (without friction and torque). Standard output gets the allocations and times as JSON.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>

#include <inverse_dynamics_solver/inverse_dynamics_solver.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <rclcpp/exceptions/exceptions.hpp>
#include CLASS_HEADER

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
}

namespace {
long allocations = 0;
}

// Every allocation of the process passes through these functions, that of operator new and of Eigen included.
extern "C" {
void* malloc(std::size_t size) noexcept { return ++allocations, __libc_malloc(size); }
void* calloc(std::size_t count, std::size_t size) noexcept { return ++allocations, __libc_calloc(count, size); }
void* realloc(void* old, std::size_t size) noexcept { return ++allocations, __libc_realloc(old, size); }
void* aligned_alloc(std::size_t to, std::size_t size) noexcept { return ++allocations, __libc_memalign(to, size); }
int posix_memalign(void** out, std::size_t to, std::size_t size) noexcept {
  ++allocations;
  *out = __libc_memalign(to, size);
  return *out == nullptr;
}
}

namespace {

using Base = inverse_dynamics_solver::InverseDynamicsSolver;
using Clock = std::chrono::steady_clock;

class Parameters : public rclcpp::node_interfaces::NodeParametersInterface {
 public:
  explicit Parameters(const char* path) {
    std::ifstream file(path);
    for (std::string line, name, type, text; std::getline(file, line);) {
      std::istringstream words(line);
      words >> name >> type;
      std::vector<double> numbers;
      while (words >> text) numbers.push_back(type == "double_array" ? std::strtod(text.c_str(), nullptr) : 0.0);
      if (type == "double_array") all_[name] = rclcpp::Parameter(numbers);
      if (type == "bool") all_[name] = rclcpp::Parameter(text == "true");
      if (type == "string") all_[name] = rclcpp::Parameter(text);
    }
  }
  bool has_parameter(const std::string& name) const override { return all_.count(name) > 0; }
  rclcpp::Parameter get_parameter(const std::string& name) const override { return all_.at(name); }
  bool get_parameter(const std::string& name, rclcpp::Parameter& parameter) const override {
    if (has_parameter(name)) parameter = all_.at(name);
    return has_parameter(name);
  }

 private:
  std::map<std::string, rclcpp::Parameter> all_;
};

template <class X>
void put(std::FILE* file, const X& x) {
  std::fwrite(x.data(), sizeof(double), static_cast<std::size_t>(x.size()), file);
}

template <class Call>
long counted(const Call& call) {
  const long before = allocations;
  call();
  return allocations - before;
}

template <class Call>
double nanoseconds(const Call& call) {
  double best = 1e300;
  for (int repetition = 0; repetition < 20; ++repetition) {
    const auto start = Clock::now();
    for (int k = 0; k < 1000; ++k) call();
    best = std::min(best, std::chrono::duration<double, std::nano>(Clock::now() - start).count() / 1000.0);
  }
  return best;
}

int run(char** arguments) {
  const std::unique_ptr<Base> solver = pluginlib_stand_in::makers<Base>().at(arguments[1])();
  const Eigen::Index n = std::atoi(arguments[2]);
  Eigen::VectorXd q(n), dq(n), ddq(n), tau(n);
  Eigen::MatrixXd M(n, n);
  try {
    solver->getGravityVector(q);
    return 2;
  } catch (const std::runtime_error& error) {
    std::cerr << error.what() << '\n';
  }
  const bool without = std::string(arguments[3]) == "none";
  solver->initialize(without ? nullptr : std::make_shared<const Parameters>(arguments[3]), "ids");
  std::FILE* in = std::fopen(arguments[4], "rb");
  std::FILE* out = std::fopen(arguments[5], "wb");
  const auto next = [&] {
    for (Eigen::VectorXd* x : {&q, &dq, &ddq})
      if (std::fread(x->data(), sizeof(double), static_cast<std::size_t>(n), in) != static_cast<std::size_t>(n))
        return false;
    return true;
  };
  while (next()) {
    put(out, solver->getInertiaMatrix(q));
    put(out, solver->getCoriolisVector(q, dq));
    put(out, solver->getGravityVector(q));
    put(out, solver->getFrictionVector(dq));
    put(out, solver->getTorques(q, dq, ddq));
    const auto [inertia, coriolis, gravity] = solver->getDynamicParameters(q, dq);
    put(out, inertia);
    put(out, coriolis);
    put(out, gravity);
  }
  std::fclose(in);
  std::fclose(out);
  try {
    solver->getGravityVector(Eigen::VectorXd::Zero(n + 1));
    return 3;
  } catch (const std::invalid_argument& error) {
    std::cerr << error.what() << '\n';
  }
  const auto* plain = dynamic_cast<const CLASS*>(solver.get());
  if (plain == nullptr) return 4;
  const long free = counted([&] {
    plain->computeInertiaMatrix(q.data(), M.data());
    plain->computeCoriolisVector(q.data(), dq.data(), tau.data());
    plain->computeGravityVector(q.data(), tau.data());
    plain->computeFrictionVector(dq.data(), tau.data());
    plain->computeTorques(q.data(), dq.data(), ddq.data(), tau.data());
  });
  const long one = counted([&] { put(stderr, solver->getTorques(q, dq, ddq).head(0)); });
  const long three = counted([&] { solver->getDynamicParameters(q, dq); });
  const long seen = counted([] { std::free(std::malloc(1 << 16)); });
  const double slow = nanoseconds([&] { tau = solver->getTorques(q, dq, ddq); });
  const double fast = nanoseconds([&] { plain->computeTorques(q.data(), dq.data(), ddq.data(), tau.data()); });
  std::printf(
      "{\"compute\": %ld, \"getTorques\": %ld, \"getDynamicParameters\": %ld, \"counter\": %ld, "
      "\"getTorques_ns\": %.1f, \"computeTorques_ns\": %.1f}\n",
      free, one, three, seen, slow, fast);
  return 0;
}

}  // namespace

int main(int, char** arguments) {
  try {
    return run(arguments);
  } catch (const rclcpp::exceptions::InvalidParameterValueException& error) {
    std::cerr << error.what() << '\n';
    return 5;
  }
}
