// Stand-in for inverse_dynamics_solver 1.0: the functions of its interface, with their names and types.
#pragma once

#include <eigen3/Eigen/Core>
#include <string>
#include <tuple>

#include <rclcpp/node_interfaces/node_parameters_interface.hpp>

namespace inverse_dynamics_solver {

class InverseDynamicsSolver {
  using Vector = Eigen::VectorXd;
  using Matrix = Eigen::MatrixXd;
  using Node = rclcpp::node_interfaces::NodeParametersInterface;

 public:
  virtual ~InverseDynamicsSolver() = default;
  virtual void initialize(Node::ConstSharedPtr node = nullptr, const std::string& prefix = "",
                          const std::string& description = "") = 0;
  virtual Matrix getInertiaMatrix(const Vector& q) const = 0;
  virtual Vector getCoriolisVector(const Vector& q, const Vector& dq) const = 0;
  virtual Vector getGravityVector(const Vector& q) const = 0;
  virtual Vector getFrictionVector(const Vector& dq) const = 0;

  virtual std::tuple<Matrix, Vector, Vector> getDynamicParameters(const Vector& q, const Vector& dq) const {
    return {getInertiaMatrix(q), getCoriolisVector(q, dq), getGravityVector(q)};
  }

  virtual Vector getTorques(const Vector& q, const Vector& dq, const Vector& ddq) const {
    Vector tau = getInertiaMatrix(q) * ddq;
    tau += getCoriolisVector(q, dq) + getGravityVector(q);
    return tau;
  }
};

}  // namespace inverse_dynamics_solver
