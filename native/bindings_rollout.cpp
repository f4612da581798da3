// Python bindings of the roll-out: conversion and checks of arrays. No mathematics.
#include "bindings.hpp"

namespace armid {

namespace {

// A roll-out's servos, laws and parameters, checked; owns nothing.
struct ServoArrays {
  In<double> gains;  // (4, n): stiffness, damping, limit, armature
  In<std::int32_t> first, operation;
  In<double> constant;
  In<std::int32_t> link, joint;
  In<double> weight, value;
};

Servos servos_of(const ArmData& data, const ServoArrays& of, double step, double steep) {
  const auto n = static_cast<std::size_t>(data.arm.n);
  require(of.gains.size() == 4 * n, "gains must be (4, n)");
  require(of.first.size() >= 1 && of.first.size() == of.link.size() && of.first.size() == of.value.size() + 1,
          "laws need limits of their operations and joints");
  require(of.operation.size() == of.constant.size(), "each operation of a law needs a constant");
  require(of.joint.size() == of.weight.size(), "each joint of a law needs a weight");
  require(step > 0.0 && steep > 0.0, "the step and the width of dry friction must be above zero");
  const int count = static_cast<int>(of.value.size());
  require(of.first.data()[0] == 0 && of.link.data()[0] == 0, "limits of laws begin with 0");
  for (int e = 0; e < count; ++e) {
    require(of.first.data()[e] < of.first.data()[e + 1] && of.link.data()[e] < of.link.data()[e + 1],
            "a law needs an operation and a joint");
    require(static_cast<std::size_t>(of.first.data()[e + 1]) <= of.operation.size() &&
                static_cast<std::size_t>(of.link.data()[e + 1]) <= of.joint.size(),
            "limits of laws lie outside their arrays");
    int depth = 0;
    for (int k = of.first.data()[e]; k < of.first.data()[e + 1]; ++k) {
      const int op = of.operation.data()[k];
      require(0 <= op && op < LAW_OPERATIONS, "an operation that there is not");
      const bool pushes = op <= LAW_VELOCITY;
      const bool joins = op == LAW_ADD || op == LAW_MULTIPLY || op == LAW_LARGER || op == LAW_SMALLER;
      require(depth >= (joins ? 2 : pushes ? 0 : 1), "an operation of a law lacks an operand");
      depth += pushes ? 1 : joins ? -1 : 0;
      require(depth <= LAW_DEPTH, "a law is nested too deeply");
    }
    require(depth == 1, "a law must leave one number");
  }
  for (std::size_t k = 0; k < of.joint.size(); ++k) {
    require(0 <= of.joint.data()[k] && of.joint.data()[k] < data.arm.n, "a law acts on a joint that is not there");
  }
  const double* gains = of.gains.data();
  return {gains,
          gains + n,
          gains + 2 * n,
          gains + 3 * n,
          {count, of.first.data(), of.operation.data(), of.constant.data(), of.link.data(), of.joint.data(),
           of.weight.data(), of.value.data()},
          step,
          steep};
}

std::int64_t roll_out(const std::string& isa, const ArmData& data, In<double> inertial, const ServoArrays& arrays,
                      double step, double steep, In<double> position, In<double> torque, Out<double> q,
                      Out<double> dq) {
  const Servos servos = servos_of(data, arrays, step, steep);
  require(inertial.size() == static_cast<std::size_t>(10 * data.arm.n), "inertial must be (n, 10)");
  require(position.ndim() == 3 && q.ndim() == 3 && dq.ndim() == 3, "commands and states must be (windows, N, n)");
  const std::size_t windows = position.shape(0), N = position.shape(1), n = data.arm.n;
  require(position.shape(2) == n && (torque.size() == 0 || torque.size() == position.size()),
          "commands must have one column a joint");
  require(q.size() == windows * (N + 1) * n && dq.size() == q.size(), "states must be (windows, N + 1, n)");
  const Kernel& k = kernel(isa);
  const Commands commands{position.data(), torque.size() ? torque.data() : nullptr};
  const double* m = inertial.data();
  double *to_q = q.data(), *to_dq = dq.data();
  nb::gil_scoped_release release;
  return k.roll_out(data.arm, m, servos, commands, static_cast<std::ptrdiff_t>(windows), static_cast<std::ptrdiff_t>(N),
                    to_q, to_dq);
}

struct ParameterArrays {
  int count;
  In<std::int32_t> offset, target, parameter;  // of the links
  In<std::int32_t> law, joint;                 // joint: (4, n): armature, stiffness, damping, limit
  In<std::int32_t> input_joint, input_parameter;
  In<double> input;
};

void roll_out_sensitivities(const std::string& isa, const ArmData& data, In<double> inertial, const ServoArrays& arrays,
                            double step, double steep, const ParameterArrays& of, In<double> position,
                            In<double> torque, In<double> q, In<double> dq, In<double> S_q, In<double> S_dq,
                            std::int64_t every, Out<double> out) {
  const Servos servos = servos_of(data, arrays, step, steep);
  const std::size_t n = data.arm.n, N = position.size() / n;
  require(inertial.size() == 10 * n, "inertial must be (n, 10)");
  require(position.size() == N * n && (torque.size() == 0 || torque.size() == position.size()),
          "commands must be (N, n)");
  require(q.size() == (N + 1) * n && dq.size() == q.size(), "states must be (N + 1, n)");
  require(every >= 1 && N >= 1, "there must be steps");
  require(of.count >= 1 && S_q.size() == n * of.count && S_dq.size() == S_q.size(), "derivatives must be (n, count)");
  require(out.size() == N / every * n * of.count, "out must be (N / every, n, count)");
  const Layout links = layout_of(data, of.offset, of.target, {});
  require(of.parameter.size() == static_cast<std::size_t>(of.offset.data()[n]), "each column needs a parameter");
  require(of.law.size() == static_cast<std::size_t>(servos.laws.count) && of.joint.size() == 4 * n,
          "each law and gain needs a parameter");
  require(of.input_joint.size() == of.input_parameter.size() && of.input.size() == of.input_joint.size() * N,
          "inputs must be (inputs, N)");
  for (std::size_t k = 0; k < of.input_joint.size(); ++k) {
    require(0 <= of.input_joint.data()[k] && static_cast<std::size_t>(of.input_joint.data()[k]) < n,
            "an input acts on a joint that is not there");
  }
  const auto known = [&](const In<std::int32_t>& parameter, int least) {
    for (std::size_t k = 0; k < parameter.size(); ++k) {
      require(least <= parameter.data()[k] && parameter.data()[k] < of.count, "a parameter that is not there");
    }
  };
  known(of.parameter, 0);
  known(of.law, -1);
  known(of.joint, -1);
  known(of.input_parameter, 0);
  const std::int32_t* joint = of.joint.data();
  const RolloutParameters parameters{of.count,
                                     links,
                                     of.parameter.data(),
                                     of.law.data(),
                                     joint,
                                     joint + n,
                                     joint + 2 * n,
                                     joint + 3 * n,
                                     static_cast<int>(of.input_joint.size()),
                                     of.input_joint.data(),
                                     of.input_parameter.data(),
                                     of.input.data()};
  const Commands commands{position.data(), torque.size() ? torque.data() : nullptr};
  const Kernel& k = kernel(isa);
  const double *m = inertial.data(), *from_q = q.data(), *from_dq = dq.data(), *at_q = S_q.data(), *at_dq = S_dq.data();
  double* to = out.data();
  nb::gil_scoped_release release;
  k.roll_out_sensitivities(data.arm, m, servos, parameters, commands, static_cast<std::ptrdiff_t>(N), from_q, from_dq,
                           at_q, at_dq, every, to);
}

}  // namespace

void bind_rollout(nb::module_& m) {
  nb::class_<ServoArrays>(m, "ServoArrays")
      .def(nb::init<In<double>, In<std::int32_t>, In<std::int32_t>, In<double>, In<std::int32_t>, In<std::int32_t>,
                    In<double>, In<double>>(),
           "gains"_a.noconvert(), "first"_a.noconvert(), "operation"_a.noconvert(), "constant"_a.noconvert(),
           "link"_a.noconvert(), "joint"_a.noconvert(), "weight"_a.noconvert(), "value"_a.noconvert());
  nb::class_<ParameterArrays>(m, "ParameterArrays")
      .def(nb::init<int, In<std::int32_t>, In<std::int32_t>, In<std::int32_t>, In<std::int32_t>, In<std::int32_t>,
                    In<std::int32_t>, In<std::int32_t>, In<double>>(),
           "count"_a, "offset"_a.noconvert(), "target"_a.noconvert(), "parameter"_a.noconvert(), "law"_a.noconvert(),
           "joint"_a.noconvert(), "input_joint"_a.noconvert(), "input_parameter"_a.noconvert(), "input"_a.noconvert());
  bind(m, "roll_out", &roll_out);
  bind(m, "roll_out_sensitivities", &roll_out_sensitivities);
}

}  // namespace armid
