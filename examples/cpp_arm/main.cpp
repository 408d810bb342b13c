// The PUMA 560 under computed torque: tracking error, speed and position of the flange over time, as CSV.
// The controller's model is the description's; the arm itself has more friction in joint2 than that.
#include "vectors.hpp"

#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

constexpr double dt = 1e-3, duration = 1.0, kp = 400.0, kd = 40.0;
constexpr std::size_t steps = 1000, every = 50;
const Vector start{0.0, -0.5, 0.5, 0.0, 0.0, 0.0}, goal{0.8, -1.0, 1.2, 0.3, -0.4, 0.6};

struct Sample {
    Vector q, v, a;
};

// A cycloid from start to goal, at rest at both ends.
Sample programmed(double t)
{
    constexpr double turn = 6.283185307179586;
    const double x = turn * t / duration;
    const Vector way = plus(goal, -1.0, start);
    return {plus(start, (x - std::sin(x)) / turn, way), plus(zero(), (1.0 - std::cos(x)) / duration, way),
            plus(zero(), turn * std::sin(x) / (duration * duration), way)};
}

// u = inverse dynamics at the programmed acceleration, corrected by the errors.
Vector computed_torque(const arm::Setup &model, const Sample &wanted, const Vector &q, const Vector &v)
{
    Vector a = plus(wanted.a, kp, plus(wanted.q, -1.0, q));
    a = plus(a, kd, plus(wanted.v, -1.0, v));
    Vector u;
    arm::inverse_dynamics(model, q, v, a, u);
    return u;
}

Vector acceleration(const arm::Setup &plant, const Vector &q, const Vector &v, const Vector &u)
{
    Vector a;
    if (const arm::Status found = arm::forward_dynamics(plant, q, v, u, a); !found)
        throw std::runtime_error("no acceleration at " + std::string(arm::coordinate_names[found.coordinate()]));
    return a;
}

// One step of the classical Runge-Kutta method under constant drives.
void step(const arm::Setup &plant, Vector &q, Vector &v, const Vector &u)
{
    const Vector a1 = acceleration(plant, q, v, u), v2 = plus(v, dt / 2, a1);
    const Vector a2 = acceleration(plant, plus(q, dt / 2, v), v2, u), v3 = plus(v, dt / 2, a2);
    const Vector a3 = acceleration(plant, plus(q, dt / 2, v2), v3, u), v4 = plus(v, dt, a3);
    const Vector a4 = acceleration(plant, plus(q, dt, v3), v4, u);
    q = plus(q, dt / 6, plus(plus(plus(v, 2.0, v2), 2.0, v3), 1.0, v4));
    v = plus(v, dt / 6, plus(plus(plus(a1, 2.0, a2), 2.0, a3), 1.0, a4));
}

void run()
{
    const arm::Setup model; // the description's values
    arm::Parameters parameters;
    parameters[arm::parameters::joints_joint2_gamma_damping] *= 1.5;
    const arm::Setup plant(parameters);

    Vector q = start, v = zero();
    std::vector<double> stored, errors, speeds; // states lie one after the other
    for (std::size_t k = 0; k <= steps; ++k) {
        const Sample wanted = programmed(static_cast<double>(k) * dt);
        if (k % every == 0) {
            Jacobian jacobian;
            arm::frame_jacobian(plant, q, arm::Frame::tcp, jacobian);
            stored.insert(stored.end(), q.data(), q.data() + arm::dof);
            errors.push_back(length(plus(q, -1.0, wanted.q)));
            speeds.push_back(speed(jacobian, v));
        }
        step(plant, q, v, computed_torque(model, wanted, q, v));
    }

    const std::size_t count = errors.size();
    std::vector<double> poses(16 * count); // all poses in one call, straight from where the states are
    arm::frame_pose_batch(plant, count, stored.data(), arm::Frame::tcp, poses.data());
    std::puts("t,error,speed,x,y,z");
    for (std::size_t i = 0; i < count; ++i) {
        const double *pose = poses.data() + 16 * i;
        std::printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", static_cast<double>(i * every) * dt, errors[i], speeds[i],
                    pose[3], pose[7], pose[11]);
    }
}

} // namespace

int main()
{
    try {
        run();
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
