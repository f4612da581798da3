// Generated C and Pinocchio's rnea on the same arm and states, in turn: what a call of each takes.
//
// Reads doubles from standard input: n, gravity (3), for each joint its placement (rotation row-major, translation) and
// its ten inertial parameters, all joints revolute about z and one after another; N, repetitions, then q, dq, ddq
// (N x n each). Writes doubles: for each repetition the CPU time of the generated code and of rnea [s], then the
// largest difference and the largest torque.
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>
#include <string>
#include <vector>

#include "arm.h"

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
    const auto p = numbers(12), body = numbers(10);
    const Eigen::Matrix3d R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.data());
    const Eigen::Vector3d t = Eigen::Map<const Eigen::Vector3d>(p.data() + 9);
    model.addJoint(i, pinocchio::JointModelRZ(), pinocchio::SE3(R, t), std::to_string(i));
    const Eigen::VectorXd parameters = Eigen::Map<const Eigen::VectorXd>(body.data(), 10);
    model.appendBodyToJoint(i + 1, pinocchio::Inertia::FromDynamicParameters(parameters), pinocchio::SE3::Identity());
  }
  pinocchio::Data data(model);
  const auto sizes = numbers(2);
  const int samples = static_cast<int>(sizes[0]), repetitions = static_cast<int>(sizes[1]);
  Eigen::MatrixXd state[3];  // one column a sample
  for (auto& x : state) {
    const auto values = numbers(static_cast<std::size_t>(samples) * n);
    x = Eigen::Map<const Eigen::MatrixXd>(values.data(), n, samples);
  }
  Eigen::MatrixXd mine(n, samples), theirs(n, samples);
  std::vector<double> out;
  for (int r = 0; r < repetitions; ++r) {
    double began = cpu_seconds();
    for (int k = 0; k < samples; ++k) {
      arm_inverse_dynamics(arm_parameters, &state[0](0, k), &state[1](0, k), &state[2](0, k), &mine(0, k));
    }
    out.push_back(cpu_seconds() - began);
    Eigen::VectorXd q(n), dq(n), ddq(n);
    began = cpu_seconds();
    for (int k = 0; k < samples; ++k) {
      q = state[0].col(k), dq = state[1].col(k), ddq = state[2].col(k);  // as a controller has them, in vectors
      theirs.col(k) = pinocchio::rnea(model, data, q, dq, ddq);
    }
    out.push_back(cpu_seconds() - began);
  }
  out.push_back((mine - theirs).cwiseAbs().maxCoeff());
  out.push_back(theirs.cwiseAbs().maxCoeff());
  return std::fwrite(out.data(), sizeof(double), out.size(), stdout) == out.size() ? 0 : 1;
}
