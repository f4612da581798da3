// Pinocchio's joint torque regressor in a C++ loop: what armid's kernel is measured against.
//
// Reads doubles from standard input: n, gravity (3), for each joint its placement (rotation row-major, translation),
// all joints revolute about z and one after another; N, repetitions, then q, dq, ddq (N x n each). Writes doubles: the
// CPU time of each repetition [s], then the regressor of the last sample, column by column.
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/multibody.hpp>
#include <string>
#include <vector>

namespace {

std::vector<double> numbers(std::size_t count) {
  std::vector<double> x(count);
  if (std::fread(x.data(), sizeof(double), count, stdin) != count) std::exit(2);
  return x;
}

double cpu_seconds() {
  timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

}  // namespace

int main() {
  const int n = static_cast<int>(numbers(1)[0]);
  pinocchio::Model model;
  const auto gravity = numbers(3);
  model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity.data());
  for (int i = 0; i < n; ++i) {
    const auto p = numbers(12);
    const Eigen::Matrix3d R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.data());
    const Eigen::Vector3d t = Eigen::Map<const Eigen::Vector3d>(p.data() + 9);
    model.addJoint(i, pinocchio::JointModelRZ(), pinocchio::SE3(R, t), std::to_string(i));
  }
  pinocchio::Data data(model);
  const auto sizes = numbers(2);
  const int samples = static_cast<int>(sizes[0]), repetitions = static_cast<int>(sizes[1]);
  Eigen::MatrixXd state[3];  // one column a sample
  for (auto& x : state) {
    const auto values = numbers(static_cast<std::size_t>(samples) * n);
    x = Eigen::Map<const Eigen::MatrixXd>(values.data(), n, samples);
  }
  std::vector<double> out;
  for (int r = 0; r < repetitions; ++r) {
    const double began = cpu_seconds();
    for (int k = 0; k < samples; ++k) {
      pinocchio::computeJointTorqueRegressor(model, data, state[0].col(k), state[1].col(k), state[2].col(k));
    }
    out.push_back(cpu_seconds() - began);
  }
  const auto& Y = data.jointTorqueRegressor;
  out.insert(out.end(), Y.data(), Y.data() + Y.size());
  return std::fwrite(out.data(), sizeof(double), out.size(), stdout) == out.size() ? 0 : 1;
}
