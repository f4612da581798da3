// Derivatives of the states of one window by parameters, beside a roll-out that is known.
//
// With the derivatives q and v of a state, those of the velocity at the step's end are x = -A⁻¹ (Gq q + Gv v) + A⁻¹ s,
// where s is what a unit of each parameter gives. The matrices of W steps are made and solved side by side in lanes,
// then turned; the derivatives of a step have a parameter in each lane.
#pragma once

#include "step.hpp"
#include "tile.hpp"

namespace armid::ARMID_ISA {

constexpr int DERIVED_ROWS = 4;  // of an arm with many joints that are made at once

// Where the parameters stand among lanes, and which joints they act on. Parameters that act on one joint stand behind
// the others, joint by joint, so that W of them act on few joints. A cell is W parameters that act on a joint.
struct Cells {
  int n, blocks, width, count = 0;
  Buffer<int> place, parameter;    // of each parameter among lanes, and of each lane
  Buffer<int> cell, first, joint;  // (n, blocks), -1 for none; of each block; of each cell

  Cells(const Arm& arm, const Laws& laws, const RolloutParameters& wanted)
      : n(arm.n), blocks(padded(wanted.count) / W), width(padded(wanted.count)), place(wanted.count),
        parameter(wanted.count), cell(n * blocks), first(blocks + 1), joint(n * blocks) {
    Buffer<std::uint8_t> acts(wanted.count * n);
    const auto act = [&](int p, int i) {
      if (p >= 0) acts[p * n + i] = 1;
    };
    for (int i = 0; i < n; ++i) {
      act(wanted.armature[i], i);
      act(wanted.stiffness[i], i);
      act(wanted.damping[i], i);
      act(wanted.limit[i], i);
      if (wanted.links.target == nullptr) continue;
      for (int c = wanted.links.offset[i]; c < wanted.links.offset[i + 1] - 1; ++c) act(wanted.parameter[c], i);
    }
    for (int e = 0; e < laws.count; ++e) {
      for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) act(wanted.law[e], laws.joint[k]);
    }
    for (int e = 0; e < wanted.inputs; ++e) act(wanted.input_parameter[e], wanted.input_joint[e]);
    arrange(acts.data(), wanted.count);
  }

  // Number of the lane register of a parameter's source at a joint.
  int slot(int i, int p) const { return cell[i * blocks + place[p] / W] * W + place[p] % W; }

 private:
  void arrange(const std::uint8_t* acts, int parameters) {
    int next = 0;
    for (int key = 0; key < 2 * n; ++key) {
      for (int p = 0; p < parameters; ++p) {
        int joints = 0, last = 0;
        for (int i = 0; i < n; ++i) {
          joints += acts[p * n + i];
          if (acts[p * n + i]) last = i;
        }
        if (key != last + (joints > 1 ? 0 : n)) continue;
        parameter[next] = p;
        place[p] = next++;
      }
    }
    for (int k = 0; k < n * blocks; ++k) cell[k] = -1;
    for (int p = 0; p < parameters; ++p) {
      for (int i = 0; i < n; ++i) {
        if (acts[p * n + i]) cell[i * blocks + place[p] / W] = 0;
      }
    }
    for (int block = 0; block < blocks; ++block) {
      first[block] = count;
      for (int i = 0; i < n; ++i) {
        if (cell[i * blocks + block] < 0) continue;
        joint[count] = i;
        cell[i * blocks + block] = count++;
      }
    }
    first[blocks] = count;
  }
};

// W steps, or fewer at the end, and where derivatives after every so many steps go.
struct StepRange {
  std::ptrdiff_t first, count, every;
  double* out;
};

class Sensitivities {
 public:
  Sensitivities(const Arm& arm, const double* inertial, const Servos& servos, const RolloutParameters& parameters)
      : arm_(arm), inertial_(inertial), servos_(servos), wanted_(parameters), n_(arm.n), each_(arm.n * W + 2 * W),
        columns_of_step_(3 * arm.n), numbers_of_step_(padded(3 * arm.n * arm.n)), cells_(arm, servos.laws, parameters),
        bodies_(arm.n), rows_(6 * each_), lanes_(6 * padded(arm.n)), maker_(arm, parameters.links, W),
        columns_(static_cast<std::size_t>(parameters.links.offset[arm.n]) * W), slots_(parameters.links.offset[arm.n]),
        M_(arm.n * arm.n), by_q_(arm.n * arm.n), by_dq_(arm.n * arm.n), A_(arm.n * arm.n), solved_(numbers_of_step_),
        sources_(cells_.count * W), steps_(numbers_of_step_ * W), turned_(cells_.count * W),
        now_(2 * arm.n * cells_.width), next_(2 * arm.n * cells_.width) {
    for (int i = 0; i < n_ && parameters.links.target != nullptr; ++i) {
      for (int c = parameters.links.offset[i]; c < parameters.links.offset[i + 1] - 1; ++c) {
        slots_[c] = cells_.slot(i, parameters.parameter[c]);
      }
    }
  }

  // q and dq (N + 1, n) of the roll-out. S_q and S_dq (n, count) at the first state; of the states every, 2 every, ...
  // the derivatives of q go to `out` (rows, n, count).
  void run(const Commands& commands, std::ptrdiff_t N, const double* q, const double* dq, const double* S_q,
           const double* S_dq, std::ptrdiff_t every, double* out) {
    const int count = wanted_.count, width = cells_.width;
    double* now = now_.data();
    for (int i = 0; i < n_; ++i) {
      for (int p = 0; p < count; ++p) {
        now[i * width + cells_.place[p]] = S_q[i * count + p];
        now[(n_ + i) * width + cells_.place[p]] = S_dq[i * count + p];
      }
    }
    for (std::ptrdiff_t s = 0; s < N; s += W) {
      linearise(commands, N, q, dq, s);
      const StepRange rows{s, smaller(W, N - s), every, out};
      by_size(n_, [&](auto of) { advance<of.size>(rows); });
    }
  }

 private:
  const Arm& arm_;
  const double* inertial_;
  const Servos& servos_;
  const RolloutParameters& wanted_;
  int n_, each_, columns_of_step_, numbers_of_step_;
  Cells cells_;
  Buffer<Body> bodies_;
  Buffer<double> rows_;  // of W steps (W, n): velocities at both ends, middle, acceleration, position error, torque
  Buffer<V> lanes_;      // the same, a step in each lane
  Columns maker_;
  Buffer<double> columns_;
  Buffer<int> slots_;                                  // of each column
  Buffer<V> M_, by_q_, by_dq_, A_, solved_, sources_;  // solved: (n, 3 n), A⁻¹ times -Gq, -Gv and 1
  Buffer<double> steps_;                               // the same of each step
  Buffer<V> turned_;                                   // sources of each step, a parameter in each lane
  Buffer<double> now_, next_;                          // derivatives (2 n, width): of q, then of dq

  // Matrices and sources of the W steps from s on; past the last step it is repeated.
  void linearise(const Commands& commands, std::ptrdiff_t N, const double* q, const double* dq, std::ptrdiff_t s) {
    read_rows(commands, N, q, dq, s);
    const V *v = lanes_.data(), *y = v + padded(n_), *middle = y + padded(n_), *a = middle + padded(n_);
    load_all(arm_, inertial_, middle, v, a, true, bodies_.data());
    torque_derivatives(arm_, bodies_.data(), M_.data(), by_q_.data(), by_dq_.data());
    const double h = servos_.step, rate = 1.0 / h;
    for (int i = 0; i < n_; ++i) {
      V* row = &solved_[i * columns_of_step_];
      for (int k = 0; k < n_; ++k) {
        const int e = i * n_ + k;
        A_[e] = rate * M_[e];
        row[k] = -by_q_[e];
        row[n_ + k] = A_[e] - 0.5 * h * by_q_[e] - by_dq_[e];
        row[2 * n_ + k] = splat(i == k ? 1.0 : 0.0);
      }
    }
    std::memset(sources_.data(), 0, sizeof(V) * cells_.count * W);
    add_law_slopes(middle, v, y);
    add_servos(N, s);
    if (wanted_.links.target != nullptr) {
      const Samples in{&rows_[2 * each_], &rows_[0], &rows_[3 * each_], nullptr, nullptr, 0, nullptr};
      maker_.make(arm_, wanted_.links, in, 0, W - 1, columns_.data());
      for (int i = 0; i < n_; ++i) {
        for (int c = wanted_.links.offset[i]; c < wanted_.links.offset[i + 1] - 1; ++c) {
          sources_[slots_[c]] -= load(&columns_[c * W]);
        }
      }
    }
    factor_small(n_, n_, A_.data());
    solve_small(n_, n_, A_.data(), solved_.data(), columns_of_step_, columns_of_step_);
    turn_lanes();
  }

  void read_rows(const Commands& commands, std::ptrdiff_t N, const double* q, const double* dq, std::ptrdiff_t s) {
    const double h = servos_.step;
    double *v = rows_.data(), *y = v + each_, *middle = y + each_, *a = middle + each_, *error = a + each_,
           *torque = error + each_;
    const std::ptrdiff_t known = smaller(W, N - s);
    for (std::ptrdiff_t l = 0; l < W; ++l) {
      const std::ptrdiff_t at = (s + smaller(l, known - 1)) * n_;
      for (int i = 0; i < n_; ++i) {
        const std::ptrdiff_t e = l * n_ + i;
        v[e] = dq[at + i];
        y[e] = dq[at + n_ + i];
        middle[e] = q[at + i] + 0.5 * h * v[e];
        a[e] = (y[e] - v[e]) / h;
        error[e] = commands.position[at + i] - q[at + i] - 0.25 * h * (v[e] + y[e]);
        torque[e] = commands.torque == nullptr ? 0.0 : commands.torque[at + i];
      }
    }
    // Behind the rows there is room for a register, so that none has to be read number by number.
    for (int k = 0; k < 6; ++k) read(rows_.data() + k * each_, 0, W + 1, n_, lanes_.data() + k * padded(n_));
  }

  void add_law_slopes(const V* middle, const V* v, const V* y) {
    const Laws& laws = servos_.laws;
    for (int e = 0; e < laws.count; ++e) {
      const Dual law = law_of_step(laws, e, middle, v, y, servos_.steep);
      const bool dry = is_dry(laws, e);
      for (int k = laws.link[e]; k < laws.link[e + 1]; ++k) {
        const int i = laws.joint[k];
        const double weight = laws.weight[k] * laws.value[e];
        for (int m = laws.link[e]; m < laws.link[e + 1]; ++m) {
          const double both = weight * laws.weight[m];
          V* row = &solved_[i * columns_of_step_ + laws.joint[m]];
          A_[i * n_ + laws.joint[m]] += both * law.by_dq;
          row[0] -= both * law.by_q;
          row[n_] -= both * (0.5 * servos_.step * law.by_q + (dry ? V{} : law.by_dq));
        }
        if (wanted_.law[e] >= 0) sources_[cells_.slot(i, wanted_.law[e])] -= laws.weight[k] * law.x;
      }
    }
  }

  void add_servos(std::ptrdiff_t N, std::ptrdiff_t s) {
    const double h = servos_.step;
    const int room = padded(n_);
    const V *v = lanes_.data(), *y = v + room, *a = v + 3 * room, *error = v + 4 * room, *torque = v + 5 * room;
    const auto add = [&](int i, int p, V source) {
      if (p >= 0) sources_[cells_.slot(i, p)] += source;
    };
    for (int i = 0; i < n_; ++i) {
      const double kp = servos_.stiffness[i], kd = servos_.damping[i], rotor = servos_.armature[i] / h;
      const V mean = 0.5 * (v[i] + y[i]), raw = kp * error[i] - kd * mean + torque[i];
      const I inside = (raw < servos_.limit[i]) & (raw > -servos_.limit[i]);
      const V share = choose(inside, splat(1.0), V{}), slope = share * (0.25 * h * kp + 0.5 * kd);
      V* row = &solved_[i * columns_of_step_ + i];
      A_[i * n_ + i] += rotor + slope;
      row[0] -= share * kp;
      row[n_] += rotor - slope;
      add(i, wanted_.armature[i], -a[i]);
      add(i, wanted_.limit[i], choose(inside, V{}, choose(raw > 0.0, splat(1.0), splat(-1.0))));
      add(i, wanted_.stiffness[i], share * error[i]);
      add(i, wanted_.damping[i], -share * mean);
      for (int e = 0; e < wanted_.inputs; ++e) {
        if (wanted_.input_joint[e] != i) continue;
        V input = {};
        std::memcpy(&input, wanted_.input + e * N + s, sizeof(double) * smaller(W, N - s));
        add(i, wanted_.input_parameter[e], share * input);
      }
    }
  }

  // From a step in each lane to one step after another.
  void turn_lanes() {
    V x[W];
    for (int e = 0; e < numbers_of_step_; e += W) {
      for (int l = 0; l < W; ++l) x[l] = solved_[e + l];
      transpose(x);
      for (int l = 0; l < W; ++l) store(&steps_[l * numbers_of_step_ + e], x[l]);
    }
    for (int c = 0; c < cells_.count; ++c) {
      for (int l = 0; l < W; ++l) x[l] = sources_[c * W + l];
      transpose(x);
      for (int l = 0; l < W; ++l) turned_[l * cells_.count + c] = x[l];
    }
  }

  // Through W steps. Few joints leave room to keep their derivatives in registers meanwhile.
  template <int J>
  void advance(const StepRange& rows) {
    if constexpr (J > 0) {
      for (int block = 0; block < cells_.blocks; ++block) advance_register<J>(rows, block);
    } else {
      for (int l = 0; l < rows.count; ++l) {
        for (int row = 0; row < n_; row += DERIVED_ROWS) {
          switch (smaller(DERIVED_ROWS, n_ - row)) {
            case 1: advance_rows<1>(l, row); break;
            case 2: advance_rows<2>(l, row); break;
            case 3: advance_rows<3>(l, row); break;
            default: advance_rows<DERIVED_ROWS>(l, row);
          }
        }
        std::memcpy(now_.data(), next_.data(), sizeof(double) * 2 * n_ * cells_.width);
        for (int block = 0; block < cells_.blocks; ++block) {
          for (int i = 0; i < n_; ++i) write(rows, l, block, i, load(&now_[i * cells_.width + block * W]));
        }
      }
    }
  }

  // Derivatives of joint i's position by a register of parameters, if they are wanted after step l.
  void write(const StepRange& rows, int l, int block, int i, V q) const {
    const std::ptrdiff_t after = rows.first + l + 1;
    if (after % rows.every != 0) return;
    double* to = rows.out + ((after / rows.every - 1) * n_ + i) * wanted_.count;
    for (int k = 0; k < W && block * W + k < wanted_.count; ++k) to[cells_.parameter[block * W + k]] = q[k];
  }

  template <int J>
  void advance_register(const StepRange& rows, int block) {
    V q[J], v[J];
    double *at_q = &now_[block * W], *at_v = at_q + J * cells_.width;
#pragma GCC unroll 8
    for (int i = 0; i < J; ++i) {
      q[i] = load(at_q + i * cells_.width);
      v[i] = load(at_v + i * cells_.width);
    }
    const double half = 0.5 * servos_.step;
    for (int l = 0; l < rows.count; ++l) {
      const double* P = &steps_[l * numbers_of_step_];
      V x[J] = {}, y[J] = {};
#pragma GCC unroll 8
      for (int k = 0; k < J; ++k) {
#pragma GCC unroll 8
        for (int i = 0; i < J; ++i) {
          x[i] += P[i * 3 * J + k] * q[k];
          y[i] += P[i * 3 * J + J + k] * v[k];
        }
      }
      for (int cell = cells_.first[block]; cell < cells_.first[block + 1]; ++cell) {
        const double* by_joint = P + 2 * J + cells_.joint[cell];
        const V source = turned_[l * cells_.count + cell];
#pragma GCC unroll 8
        for (int i = 0; i < J; ++i) y[i] += by_joint[i * 3 * J] * source;
      }
#pragma GCC unroll 8
      for (int i = 0; i < J; ++i) {
        x[i] += y[i];
        q[i] += half * (v[i] + x[i]);
        v[i] = x[i];
      }
      if ((rows.first + l + 1) % rows.every != 0) continue;
#pragma GCC unroll 8
      for (int i = 0; i < J; ++i) write(rows, l, block, i, q[i]);
    }
#pragma GCC unroll 8
    for (int i = 0; i < J; ++i) {
      store(at_q + i * cells_.width, q[i]);
      store(at_v + i * cells_.width, v[i]);
    }
  }

  template <int R>
  void advance_rows(int l, int row) {
    int block = 0;
    for (; block + 2 <= cells_.blocks; block += 2) advance_block<R, 2>(l, row, block);
    for (; block < cells_.blocks; ++block) advance_block<R, 1>(l, row, block);
  }

  // R rows of the derivatives by C registers of parameters.
  template <int R, int C>
  void advance_block(int l, int row, int block) {
    const double* from = now_.data();
    double* to = next_.data();
    const int width = cells_.width, stride = columns_of_step_;
    const double* P = &steps_[l * numbers_of_step_ + row * stride];
    const V* turned = &turned_[l * cells_.count];
    V x[R][C] = {};
    for (int k = 0; k < 2 * n_; ++k) {
      V known[C];
#pragma GCC unroll 8
      for (int c = 0; c < C; ++c) known[c] = load(from + k * width + (block + c) * W);
#pragma GCC unroll 8
      for (int r = 0; r < R; ++r) {
#pragma GCC unroll 8
        for (int c = 0; c < C; ++c) x[r][c] += P[r * stride + k] * known[c];
      }
    }
#pragma GCC unroll 8
    for (int c = 0; c < C; ++c) {
      for (int cell = cells_.first[block + c]; cell < cells_.first[block + c + 1]; ++cell) {
        const double* by_joint = P + 2 * n_ + cells_.joint[cell];
#pragma GCC unroll 8
        for (int r = 0; r < R; ++r) x[r][c] += by_joint[r * stride] * turned[cell];
      }
    }
#pragma GCC unroll 8
    for (int r = 0; r < R; ++r) {
#pragma GCC unroll 8
      for (int c = 0; c < C; ++c) {
        const std::ptrdiff_t at = (row + r) * width + (block + c) * W, rate = at + n_ * width;
        store(to + at, load(from + at) + 0.5 * servos_.step * (load(from + rate) + x[r][c]));
        store(to + rate, x[r][c]);
      }
    }
  }
};

}  // namespace armid::ARMID_ISA
