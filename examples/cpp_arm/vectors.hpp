/* The little vector algebra that the program needs: Eigen's, or that of std::array. */
#ifndef CPP_ARM_VECTORS_HPP
#define CPP_ARM_VECTORS_HPP

#include <eomgen/puma560.hpp>

#include <cmath>

namespace arm = eomgen::puma560;

#if EOMGEN_EIGEN
using Vector = arm::EigenMatrix<arm::dof>;
using Jacobian = arm::EigenMatrix<6, arm::dof>;

inline Vector zero() { return Vector::Zero(); }

inline Vector plus(const Vector &x, double factor, const Vector &y) { return x + factor * y; }

inline double length(const Vector &x) { return x.norm(); }

/* Speed of the frame's origin. */
inline double speed(const Jacobian &jacobian, const Vector &v) { return (jacobian.topRows<3>() * v).norm(); }
#else
using Vector = std::array<double, arm::dof>;
using Jacobian = std::array<double, 6 * arm::dof>;

inline Vector zero() { return {}; }

inline Vector plus(Vector x, double factor, const Vector &y)
{
    for (std::size_t i = 0; i < arm::dof; ++i) x[i] += factor * y[i];
    return x;
}

inline double length(const Vector &x)
{
    double sum = 0.0;
    for (const double value : x) sum += value * value;
    return std::sqrt(sum);
}

/* Speed of the frame's origin. */
inline double speed(const Jacobian &jacobian, const Vector &v)
{
    double sum = 0.0;
    for (std::size_t row = 0; row < 3; ++row) {
        double component = 0.0;
        for (std::size_t i = 0; i < arm::dof; ++i) component += jacobian[row * arm::dof + i] * v[i];
        sum += component * component;
    }
    return std::sqrt(sum);
}
#endif

#endif
