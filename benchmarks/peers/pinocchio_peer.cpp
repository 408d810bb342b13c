// Pinocchio behind functions with a kernel's arguments: (h, arrays..., out), h being what pinocchio_load returns.
//
// Its headers alone, at full optimisation: its library is not linked, which -march=native would break (alignments
// differ).  The parts are compiled apart, side by side: PART is 1 (model, inverse dynamics), 2 (mass matrix, forward
// dynamics), 3 (derivatives) or 4 (second derivatives).
//
// A null out leaves the result where Pinocchio has it, so that no copy is timed.
#include "pinocchio/multibody.hpp"
#if PART == 1
#include "pinocchio/algorithm/rnea.hpp"
#include "pinocchio_model.hpp"
#elif PART == 2
#include "pinocchio/algorithm/aba.hpp"
#include "pinocchio/algorithm/crba.hpp"
#elif PART == 4
#include "pinocchio/algorithm/rnea-second-order-derivatives.hpp"
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
  Eigen::MatrixXd hessian;  // of the contracted inverse dynamics by q, v, a
};

static Peer &peer(const double *h) { return *reinterpret_cast<Peer *>(const_cast<double *>(h)); }

#if PART == 1
extern "C" void *pinocchio_load(const char *text) {
  Peer *made = new Peer;
  if (!read_model(text, made->model)) return nullptr;
  made->data = new Data(made->model);
  made->hessian = Eigen::MatrixXd::Zero(3 * made->model.nv, 3 * made->model.nv);
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
#elif PART == 4
using Cube = Eigen::Tensor<double, 3>;

// The sum over i of w_i tensor(i, j, k), into the block of so many rows and columns, and turned over behind the diagonal.
static void contract(const Cube &tensor, const Vector &w, Eigen::MatrixXd &out, int row, int column) {
  const Eigen::Index n = w.size();
  const Eigen::Map<const Eigen::MatrixXd> flat(tensor.data(), n, n * n);
  for (Eigen::Index k = 0; k < n; ++k)
    out.block(row * n, column * n + k, n, 1).noalias() = flat.middleCols(k * n, n).transpose() * w;
  if (row != column) out.block(column * n, row * n, n, n) = out.block(row * n, column * n, n, n).transpose();
}

static void tensors(Peer &p, const double *q, const double *v, const double *a) {
  const int n = p.model.nv;
  ComputeRNEASecondOrderDerivatives(p.model, *p.data, Vector(q, n), Vector(v, n), Vector(a, n));
}

static void contracted(Peer &p, const double *w) {
  const Vector weights(w, p.model.nv);
  contract(p.data->d2tau_dqdq, weights, p.hessian, 0, 0);
  contract(p.data->d2tau_dvdv, weights, p.hessian, 1, 1);
  contract(p.data->d2tau_dqdv, weights, p.hessian, 0, 1);  // of a torque by q, then by v
  contract(p.data->d2tau_dadq, weights, p.hessian, 2, 0);  // by a, then by q
}

static int result(const Peer &p, double *out) {
  const Eigen::Index size = p.hessian.rows();
  if (out) Rows(out, size, size) = p.hessian;
  return 0;
}

// Second derivatives of w . rnea by (q, v, a), as a user of the tensors gets them.
extern "C" int pinocchio_second_derivatives(const double *h, const double *q, const double *v, const double *a, const double *w, double *out) {
  Peer &p = peer(h);
  tensors(p, q, v, a);
  contracted(p, w);
  return result(p, out);
}

// The tensors alone; they are contracted where a result is asked for, so that it can be compared.
extern "C" int pinocchio_second_tensors(const double *h, const double *q, const double *v, const double *a, const double *w, double *out) {
  Peer &p = peer(h);
  tensors(p, q, v, a);
  if (out) contracted(p, w);
  return result(p, out);
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
