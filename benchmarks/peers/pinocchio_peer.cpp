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
#include "pinocchio_model.hpp"
#elif PART == 2
#include "pinocchio/algorithm/aba.hpp"
#include "pinocchio/algorithm/crba.hpp"
#else
#include "pinocchio/algorithm/aba-derivatives.hpp"
#include "pinocchio/algorithm/rnea-derivatives.hpp"
#endif

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
extern "C" void *pinocchio_load(const char *text) {
  Peer *made = new Peer;
  if (!read_model(text, made->model)) return nullptr;
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

// Of the accelerations by q, by v and by u (the inverse mass matrix).
extern "C" int pinocchio_forward_derivatives(const double *h, const double *q, const double *v, const double *u, double *out) {
  Peer &p = peer(h);
  const int n = p.model.nv;
  computeABADerivatives(p.model, *p.data, Vector(q, n), Vector(v, n), Vector(u, n));
  if (!out) return 0;
  Rows(out, n, n) = p.data->ddq_dq;
  Rows(out + n * n, n, n) = p.data->ddq_dv;
  Rows(out + 2 * n * n, n, n) = p.data->Minv.selfadjointView<Eigen::Upper>();
  return 0;
}
#endif
