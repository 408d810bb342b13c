// Pinocchio's algorithms traced with CasADi for one robot: model text on stdin, C on stdout.
//
// The C holds what CasADi generates and a function with a kernel's arguments around each.
#include "pinocchio/autodiff/casadi.hpp"
#include "pinocchio/multibody.hpp"
#include "pinocchio/algorithm/aba.hpp"
#include "pinocchio/algorithm/crba.hpp"
#include "pinocchio/algorithm/rnea.hpp"
#include "pinocchio_model.hpp"
#include <iostream>

using Symbol = ::casadi::SX;
using Vector = Eigen::Matrix<Symbol, Eigen::Dynamic, 1>;

static Vector of(const Symbol &x) {
  Vector result(x.size1());
  for (int i = 0; i < x.size1(); ++i) result[i] = x(i);
  return result;
}

template <class Matrix> static Symbol rows(const Matrix &m) {
  Symbol result(m.rows() * m.cols(), 1);
  for (int i = 0; i < m.rows(); ++i)
    for (int k = 0; k < m.cols(); ++k) result(i * m.cols() + k) = m(i, k);
  return result;
}

static void write(::casadi::CodeGenerator &code, std::string &wrappers, const std::string &kernel,
                  const std::vector<Symbol> &reads, const Symbol &result) {
  const ::casadi::Function f("traced_" + kernel, reads, {Symbol::densify(result)});
  code.add(f);
  std::ostringstream text;
  text << "\nint casadi_" << kernel << "(const double *h";
  for (size_t i = 0; i < reads.size(); ++i) text << ", const double *x" << i;
  text << ", double *out)\n{\n    const double *arg[" << f.sz_arg() << "] = { ";
  for (size_t i = 0; i < reads.size(); ++i) text << (i ? ", x" : "x") << i;
  text << " };\n    double *res[" << f.sz_res() << "] = { out };\n    double w[" << f.sz_w() + 1 << "];\n    (void)h;\n"
       << "    return traced_" << kernel << "(arg, res, 0, w, 0);\n}\n";
  wrappers += text.str();
}

int main() {
  std::ostringstream text;
  text << std::cin.rdbuf();
  pinocchio::Model model;
  if (!read_model(text.str(), model)) return 1;
  const pinocchio::ModelTpl<Symbol> traced = model.cast<Symbol>();
  pinocchio::DataTpl<Symbol> data(traced);
  const int n = model.nv;
  const Symbol q = Symbol::sym("q", n), v = Symbol::sym("v", n), a = Symbol::sym("a", n);
  ::casadi::CodeGenerator code("traced");
  std::string wrappers;
  write(code, wrappers, "inverse_dynamics", {q, v, a}, rows(pinocchio::rnea(traced, data, of(q), of(v), of(a))));
  pinocchio::crba(traced, data, of(q));
  data.M.template triangularView<Eigen::StrictlyLower>() =
      data.M.transpose().template triangularView<Eigen::StrictlyLower>();
  write(code, wrappers, "mass_matrix", {q}, rows(data.M));
  write(code, wrappers, "forward_dynamics", {q, v, a}, rows(pinocchio::aba(traced, data, of(q), of(v), of(a))));
  std::cout << code.dump() << wrappers;
  return 0;
}
