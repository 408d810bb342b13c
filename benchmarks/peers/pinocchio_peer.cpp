// Pinocchio behind functions with a kernel's arguments: (h, arrays..., out), h being what pinocchio_load returns.
//
// Its headers alone, at full optimisation: its library is not linked, which -march=native would break (alignments
// differ).  The parts are compiled apart, side by side: PART is 1 (model, inverse dynamics), 2 (mass matrix, forward
// dynamics) or 3 (derivatives).
//
// A null out leaves the result where Pinocchio has it, so that no copy is timed.
#include "pinocchio/multibody.hpp"
#if PART == 1
#include "pinocchio/algorithm/rnea.hpp"
#elif PART == 2
#include "pinocchio/algorithm/aba.hpp"
#include "pinocchio/algorithm/crba.hpp"
#else
#include "pinocchio/algorithm/rnea-derivatives.hpp"
#endif
#include <sstream>

using namespace pinocchio;
using Vector = Eigen::Map<const Eigen::VectorXd>;
using Result = Eigen::Map<Eigen::VectorXd>;
using Rows = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

struct Peer {
  Model model;
  Data *data;
};

static Peer &peer(const double *h) { return *reinterpret_cast<Peer *>(const_cast<double *>(h)); }

#if PART == 1
template <class X, class Y, class Z, class Any>
static JointIndex add(Model &model, const double *row, const SE3 &placement, const std::string &name) {
  const Eigen::Vector3d axis(row[2], row[3], row[4]);
  const JointIndex parent = static_cast<JointIndex>(row[0]);
  if (axis == Eigen::Vector3d::UnitX()) return model.addJoint(parent, X(), placement, name);
  if (axis == Eigen::Vector3d::UnitY()) return model.addJoint(parent, Y(), placement, name);
  if (axis == Eigen::Vector3d::UnitZ()) return model.addJoint(parent, Z(), placement, name);
  return model.addJoint(parent, Any(axis), placement, name);
}

// The text: gravity(3), number of joints, then per joint
//   parent kind(0 revolute, 1 prismatic) axis(3) rotation(9, by rows) origin(3) mass com(3) inertia about com(9)
extern "C" void *pinocchio_load(const char *text) {
  std::istringstream in(text);
  Peer *made = new Peer;
  Eigen::Vector3d gravity;
  int joints;
  in >> gravity[0] >> gravity[1] >> gravity[2] >> joints;
  made->model.gravity.linear(gravity);
  for (int i = 0; i < joints; ++i) {
    double row[30];
    for (double &number : row) in >> number;
    if (!in) return nullptr;
    Eigen::Matrix3d rotation, inertia;
    for (int k = 0; k < 9; ++k) rotation(k / 3, k % 3) = row[5 + k], inertia(k / 3, k % 3) = row[21 + k];
    const SE3 placement(rotation, Eigen::Vector3d(row[14], row[15], row[16]));
    const std::string name = "j" + std::to_string(i);
    const JointIndex joint =
        row[1] == 0 ? add<JointModelRX, JointModelRY, JointModelRZ, JointModelRevoluteUnaligned>(made->model, row, placement, name)
                    : add<JointModelPX, JointModelPY, JointModelPZ, JointModelPrismaticUnaligned>(made->model, row, placement, name);
    const Inertia body(row[17], Eigen::Vector3d(row[18], row[19], row[20]), inertia);
    made->model.appendBodyToJoint(joint, body, SE3::Identity());
  }
  made->data = new Data(made->model);
  return made;
}

extern "C" int pinocchio_inverse_dynamics(const double *h, const double *q, const double *v, const double *a, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  rnea(p.model, *p.data, Vector(q, n), Vector(v, n), Vector(a, n));
  if (out) Result(out, n) = p.data->tau;
  return 0;
}
#elif PART == 2
extern "C" int pinocchio_mass_matrix(const double *h, const double *q, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  crba(p.model, *p.data, Vector(q, n));  // the upper triangle
  if (out) Rows(out, n, n) = p.data->M.selfadjointView<Eigen::Upper>();
  return 0;
}

extern "C" int pinocchio_mass_matrix_world(const double *h, const double *q, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  crba(p.model, *p.data, Vector(q, n), Convention::WORLD);
  if (out) Rows(out, n, n) = p.data->M.selfadjointView<Eigen::Upper>();
  return 0;
}

extern "C" int pinocchio_forward_dynamics(const double *h, const double *q, const double *v, const double *u, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  aba(p.model, *p.data, Vector(q, n), Vector(v, n), Vector(u, n));
  if (out) Result(out, n) = p.data->ddq;
  return 0;
}

extern "C" int pinocchio_forward_dynamics_world(const double *h, const double *q, const double *v, const double *u, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  aba(p.model, *p.data, Vector(q, n), Vector(v, n), Vector(u, n), Convention::WORLD);
  if (out) Result(out, n) = p.data->ddq;
  return 0;
}
#else
// By q, by v and by a (the mass matrix, which comes with them), one after the other.
extern "C" int pinocchio_derivatives(const double *h, const double *q, const double *v, const double *a, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  computeRNEADerivatives(p.model, *p.data, Vector(q, n), Vector(v, n), Vector(a, n));
  if (!out) return 0;
  Rows(out, n, n) = p.data->dtau_dq;
  Rows(out + n * n, n, n) = p.data->dtau_dv;
  Rows(out + 2 * n * n, n, n) = p.data->M.selfadjointView<Eigen::Upper>();
  return 0;
}
#endif
