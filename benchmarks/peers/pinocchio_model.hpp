// A model from text: gravity(3), number of joints, then per joint
//   parent kind(0 revolute, 1 prismatic) axis(3) rotation(9, by rows) origin(3) mass com(3) inertia about com(9)
#include "pinocchio/multibody.hpp"
#include <sstream>
#include <string>

template <class X, class Y, class Z, class Any>
static pinocchio::JointIndex add_joint(pinocchio::Model &model, const double *row, const pinocchio::SE3 &placement,
                                       const std::string &name) {
  const Eigen::Vector3d axis(row[2], row[3], row[4]);
  const auto parent = static_cast<pinocchio::JointIndex>(row[0]);
  if (axis == Eigen::Vector3d::UnitX()) return model.addJoint(parent, X(), placement, name);
  if (axis == Eigen::Vector3d::UnitY()) return model.addJoint(parent, Y(), placement, name);
  if (axis == Eigen::Vector3d::UnitZ()) return model.addJoint(parent, Z(), placement, name);
  return model.addJoint(parent, Any(axis), placement, name);
}

static bool read_model(const std::string &text, pinocchio::Model &model) {
  using namespace pinocchio;
  std::istringstream in(text);
  Eigen::Vector3d gravity;
  int joints = 0;
  in >> gravity[0] >> gravity[1] >> gravity[2] >> joints;
  model.gravity.linear(gravity);
  for (int i = 0; i < joints; ++i) {
    double row[30];
    for (double &number : row) in >> number;
    if (!in) return false;
    Eigen::Matrix3d rotation, inertia;
    for (int k = 0; k < 9; ++k) rotation(k / 3, k % 3) = row[5 + k], inertia(k / 3, k % 3) = row[21 + k];
    const SE3 placement(rotation, Eigen::Vector3d(row[14], row[15], row[16]));
    const std::string name = "j" + std::to_string(i);
    const JointIndex joint =
        row[1] == 0
            ? add_joint<JointModelRX, JointModelRY, JointModelRZ, JointModelRevoluteUnaligned>(model, row, placement, name)
            : add_joint<JointModelPX, JointModelPY, JointModelPZ, JointModelPrismaticUnaligned>(model, row, placement, name);
    const Inertia body(row[17], Eigen::Vector3d(row[18], row[19], row[20]), inertia);
    model.appendBodyToJoint(joint, body, SE3::Identity());
  }
  return joints > 0;
}
