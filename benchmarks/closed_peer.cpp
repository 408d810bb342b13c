// Pinocchio's dynamics of mechanisms with loops behind a kernel's arguments: (h, q, v, u, out), h being what
// closed_load returns.  As pinocchio_peer.cpp does it: headers alone, PART 1 (constraintDynamics) and 2 (lcaba) apart.
//
// Text of the loops: their number, then per loop 3 or 6 (directions that are closed), and twice
//   joint rotation(9, by rows) origin(3)
#include "pinocchio/multibody.hpp"
#if PART == 1
#include "pinocchio/algorithm/constrained-dynamics.hpp"
#include "pinocchio_model.hpp"
#else
#include "pinocchio/algorithm/loop-constrained-aba.hpp"
#endif

using namespace pinocchio;
using Vector = Eigen::Map<const Eigen::VectorXd>;
using Result = Eigen::Map<Eigen::VectorXd>;

struct Closed {
  Model model;
  Data *data;
  PINOCCHIO_STD_VECTOR_WITH_EIGEN_ALLOCATOR(RigidConstraintModel) cuts;
  PINOCCHIO_STD_VECTOR_WITH_EIGEN_ALLOCATOR(RigidConstraintData) kept;
  ProximalSettings settings;
  int most;  // iterations that were needed
};

static Closed &closed(const double *h) { return *reinterpret_cast<Closed *>(const_cast<double *>(h)); }

static int finish(Closed &c, const Eigen::VectorXd &a, double *out) {
  if (c.settings.iter > c.most) c.most = c.settings.iter;
  if (out) Result(out, c.model.nv) = a;
  return 0;
}

#if PART == 1
void closed_order(const Model &model, Data &data, const PINOCCHIO_STD_VECTOR_WITH_EIGEN_ALLOCATOR(RigidConstraintModel) &cuts);

extern "C" void *closed_load(const char *model, const char *loops, double mu, double accuracy, int iterations) {
  Closed *made = new Closed;
  std::istringstream in(loops);
  int count = 0;
  if (!read_model(model, made->model) || !(in >> count)) return nullptr;
  for (int i = 0; i < count; ++i) {
    int rows = 0, joint[2] = {0, 0};
    SE3 placed[2];
    in >> rows;
    for (int side = 0; side < 2; ++side) {
      Eigen::Matrix3d rotation;
      Eigen::Vector3d origin;
      in >> joint[side];
      for (int k = 0; k < 9; ++k) in >> rotation(k / 3, k % 3);
      for (int k = 0; k < 3; ++k) in >> origin[k];
      placed[side] = SE3(rotation, origin);
    }
    if (!in) return nullptr;
    const int first = joint[0] == 0;  // lcaba: the ground is the second
    made->cuts.push_back(RigidConstraintModel(rows == 3 ? CONTACT_3D : CONTACT_6D, made->model, (JointIndex)joint[first],
                                              placed[first], (JointIndex)joint[1 - first], placed[1 - first], LOCAL));
    made->kept.push_back(made->cuts.back().createData());
  }
  made->data = new Data(made->model);
  made->settings = ProximalSettings(accuracy, mu, iterations);
  made->most = 0;
  initConstraintDynamics(made->model, *made->data, made->cuts, made->kept);
  closed_order(made->model, *made->data, made->cuts);
  return made;
}

extern "C" int closed_iterations(const double *h) { return closed(h).most; }

extern "C" int closed_constraint_dynamics(const double *h, const double *q, const double *v, const double *u, double *out) {
  Closed &c = closed(h);
  const int n = c.model.nv;
  constraintDynamics(c.model, *c.data, Vector(q, n), Vector(v, n), Vector(u, n), c.cuts, c.kept, c.settings);
  return finish(c, c.data->ddq, out);
}
#else
void closed_order(const Model &model, Data &data, const PINOCCHIO_STD_VECTOR_WITH_EIGEN_ALLOCATOR(RigidConstraintModel) &cuts) {
  computeJointMinimalOrdering(model, data, cuts);
}

extern "C" int closed_lcaba(const double *h, const double *q, const double *v, const double *u, double *out) {
  Closed &c = closed(h);
  const int n = c.model.nv;
  lcaba(c.model, *c.data, Vector(q, n), Vector(v, n), Vector(u, n), c.cuts, c.kept, c.settings);
  return finish(c, c.data->ddq, out);
}
#endif
