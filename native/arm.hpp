// The constant geometry of an arm, and where the columns of its regressor go: plain data that every instruction
// set's translation unit reads.
//
// Nothing here or in the kernel's headers may be an inline function or a template shared between translation units:
// the linker would keep one copy of it, perhaps the one compiled for a wider instruction set than the machine has.
#pragma once

#include <cstddef>
#include <cstdint>

namespace armid {

// A joint is square where its axis is one of its own frame's, and that frame at q = 0 is the parent's up to right
// angles. So nearly all arms are built, and a turn then takes 4 products instead of 9. The rest frame of a square joint
// is the link's at q = 0, that of any other joint the parent's.
constexpr std::int32_t GENERAL = 3;

struct JointConstants {
  std::int32_t parent;  // -1 for the base
  bool prismatic;
  double axis[3];  // unit axis in the joint's own frame
  // Component k of a vector in the rest frame is component from[k] in the parent's, with the other sign where flip[k]
  // has its sign bit set.
  std::int32_t from[3];
  std::int64_t flip[3];
  double lever[3];      // origin at q = 0 in the rest frame
  double slide[3];      // axis in the rest frame
  std::int32_t single;  // the only component of the origin that is not zero at every q; GENERAL where there are more
  // The axis of a square joint is sense times unit vector `about`; that of others has about = GENERAL.
  std::int32_t about;
  double sense;
  // Rotation of a general joint's link in its parent at q: along + sin(q) cross + cos(q) across, row-major.
  double along[9], cross[9], across[9];
};

struct Arm {
  int n;
  const JointConstants* joints;
  double gravity[3];
  // All ancestors of link i, base first and i last, are ancestor[first[i]] ... ancestor[first[i + 1] - 1]. The index
  // into this list is called a pair (link i, joint j).
  const std::int32_t *first, *ancestor;
};

// Which columns each joint's rows have. Joint j owns columns offset[j] ... offset[j + 1] - 1; the last is its torque.
struct Layout {
  const std::int32_t* offset;
  const std::int32_t* target;  // pairs x 10: column within the joint's own, -1 where not wanted; null for no bodies
  const std::int32_t* term;    // column of each row of the terms
  int terms;
};

// How the joints' columns add up to information about parameters.
struct Weighing {
  int count;                      // of parameters
  const std::int32_t* parameter;  // of each column of the layout; that of torques does not matter
  const double* weight;           // of each joint's rows
};

// Products (k + 1, k + 1) of the columns of each joint and its torque, one joint behind another.
struct JointProducts {
  int joints, count;              // of parameters
  const std::int32_t* offset;     // columns before those of each joint, n + 1
  const std::int32_t* parameter;  // of each column, rising within a joint
  const double* values;
  const double* sign;  // factor of each joint's torque
  const double* rows;  // number of rows of each joint
};

// Rules of the passes in which joints are weighted by their residuals.
struct Reweighting {
  int passes;
  double settled;  // relative change of all residuals below which the passes end
  double floor;    // smallest ratio of residual to torque
  double ridge;    // added to the diagonal of the products of unit columns
};

// What a motion looks like to the kernel: row-major (N, n), terms (terms, N) with their own row stride.
struct Samples {
  const double *q, *dq, *ddq;
  const double* torque;  // (N, n)
  const double* terms;
  std::ptrdiff_t term_stride;
  const std::uint8_t* mask;  // (N, n), or null where every row counts
};

// Laws of torque that the state of one coordinate gives, as programs on a stack.
enum LawOperation {
  LAW_NUMBER,
  LAW_POSITION,
  LAW_VELOCITY,
  LAW_ADD,
  LAW_MULTIPLY,
  LAW_POWER,
  LAW_SIGN,
  LAW_TANH,
  LAW_ABSOLUTE,
  LAW_EXPONENTIAL,
  LAW_SINE,
  LAW_COSINE,
  LAW_LARGER,
  LAW_SMALLER,
  LAW_OPERATIONS
};
constexpr int LAW_DEPTH = 16;  // numbers on the stack

struct Laws {
  int count;
  const std::int32_t* first;      // operations of each law, count + 1
  const std::int32_t* operation;  // a LawOperation
  const double* constant;         // of LAW_NUMBER, and the exponent of LAW_POWER
  const std::int32_t* link;       // joints of each law's coordinate, count + 1 limits
  const std::int32_t* joint;
  const double* weight;  // of each of these joints
  const double* value;   // parameter of each law
};

// A servo that holds each joint to a command, with what its joint has beside links.
struct Servos {
  const double *stiffness, *damping;  // torque for a unit of position error, and of velocity
  const double* limit;                // largest torque
  const double* armature;
  Laws laws;
  double step;   // of the integration
  double steep;  // velocity up to which a joint sticks
};

// Commands between the N + 1 states of each window, row-major (N, n): the mean over a step.
struct Commands {
  const double* position;
  const double* torque;  // added to that of the position error
};

// Parameters by which a roll-out is differentiated: columns 0 ... count - 1, or -1 where not wanted.
struct RolloutParameters {
  int count;
  Layout links;                   // the wanted inertial parameters; every joint's last column is not used
  const std::int32_t* parameter;  // of each column of the layout
  const std::int32_t *law, *armature, *stiffness, *damping, *limit;
  // Inputs: what adds to the servo's torque for a unit of a parameter, (inputs, N).
  int inputs;
  const std::int32_t *input_joint, *input_parameter;
  const double* input;
};

}  // namespace armid
