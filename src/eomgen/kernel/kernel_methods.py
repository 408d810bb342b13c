"""Methods of kernels, written by ``python -m release.kernel_methods`` from the table of kernels.

Docstrings may be edited here: but for arguments they are kept.
"""

# mypy: disable-error-code="empty-body"

from __future__ import annotations

from numpy.typing import ArrayLike

from ..runtime.bound import WrenchLike
from ..runtime.direct import BoundFunctions
from ..runtime.raw import Array
from .declared_methods import kernel_method


class KernelMethods:
    """Methods of kernels that call a function of C each; see ``Kernel`` for arrays, batches and errors."""

    _bound: BoundFunctions

    @kernel_method()
    def mass_matrix(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the mass matrix M(q), (n, n), symmetric; eq. (11); kg, kg m or kg m^2 by its coordinates."""

    @kernel_method()
    def bias_force(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return Coriolis and centrifugal terms without gravity, (n,), N or N m: sum_vw C^svw v w of eq. (12).

        ``nonlinear_effects`` has gravity in it, as what MuJoCo and Featherstone call bias has.
        """

    @kernel_method()
    def generalized_force(
        self,
        q: ArrayLike,
        v: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        z: ArrayLike | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return Q_P + Q_G, eqs. (13) and (14), (n,), N or N m; with wrenches Q_F, too.

        Args:
            q, v: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.
        """

    @kernel_method()
    def residual(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        u: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        z: ArrayLike | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return M a + bias - generalized_force - u, (n,), N or N m; zero on a motion.

        Args:
            q, v, a, u: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.
        """

    @kernel_method()
    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        z: ArrayLike | None = None,
        cut: bool = False,
        out: Array | None = None,
    ) -> Array:
        """Return the actuator forces u, (n,), N or N m, that make a motion: the residual is zero, but for loop forces.

        Of a robot with loops: M a + h = u + J^T lambda with u at the coordinates that have a drive alone, prescribed
        ones among them, and 0 elsewhere; of several possible drives the least by the sum of their squares.

        Args:
            q, v, a: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            cut: of a robot with loops: compute the open tree, whose loops are cut.
            out: array to write to.

        Raises:
            LoopError: a loop is open, opening, or opens at the accelerations, by more than 1e-9 (float32: 1e-5) m or
                rad (per second and the largest rate; per second squared and the largest acceleration); or these drives
                cannot make the motion.
        """

    @kernel_method()
    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        z: ArrayLike | None = None,
        *,
        wrench: WrenchLike | None = None,
        cut: bool = False,
        out: Array | None = None,
    ) -> Array:
        """Return accelerations, (n,), m/s^2 or rad/s^2, under the drives u.

        In ``u`` a prescribed coordinate has its acceleration, m/s^2 or rad/s^2, which the result repeats; the force
        that this takes is ``inverse_dynamics`` at the result.  Loops are closed.

        Args:
            q, v, u: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            cut: of a robot with loops: compute the open tree, whose loops are cut.
            out: array to write to.

        Raises:
            SingularError: M cannot be inverted in this state.
            LoopError: a loop is open, or opening, by more than 1e-9 (float32: 1e-5) m or rad (per second and the
                largest rate).
        """

    @kernel_method()
    def coriolis_matrix(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the Coriolis matrix C(q, v), (n, n), by Christoffel symbols: C v = bias, M_dot = C + C^T."""

    @kernel_method()
    def christoffel(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return Christoffel symbols of the first kind, (n, n, n): C^svw of eq. (12), symmetric in the last two."""

    @kernel_method()
    def frame_pose(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """Return A_0k of a frame or link in the base, (4, 4), m; eqs. (1) and (2).

        Args:
            q: (n,).
            frame: name of a frame or link.
            out: array to write to.

        Raises:
            UnknownNameError: no frame or link of that name.
        """

    @kernel_method()
    def frame_jacobian(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """Return a frame's Jacobian, (6, n), in the base frame: its origin's velocity, then angular velocity, per rate.

        Args:
            q: (n,).
            frame: name of a frame or link.
            out: array to write to.

        Raises:
            UnknownNameError: no frame or link of that name.
        """

    @kernel_method()
    def gravity(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return forces g(q) that hold the links' weight, (n,), N or N m, on the side of M a: tau = M a + C v + g.

        They come of the masses alone; springs and dampers are in ``generalized_force``.  Of a robot with loops: of its
        open tree.
        """

    @kernel_method()
    def nonlinear_effects(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return C v + g, (n,), N or N m: ``bias_force`` and ``gravity`` together, which other libraries call the bias.

        Springs and dampers are in ``generalized_force``.  Of a robot with loops: of its open tree.
        """

    @kernel_method()
    def center_of_mass(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the center of mass of the links that move, (3,), m, in the base frame.

        Links that are fixed to the base do not count.
        """

    @kernel_method()
    def centroidal_momentum(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the momentum of moving links, (6,), base frame: linear (kg m/s), angular about the center (kg m^2/s).

        Rotors of motors (``armature``) are not in it: a description does not say about which axes they turn.
        """

    @kernel_method()
    def energy(self, q: ArrayLike, v: ArrayLike, *, z: ArrayLike | None = None, out: Array | None = None) -> Array:
        """Return (kinetic, potential) energy, (2,), J: eq. (4); gravity (zero at the base's origin), springs, states z.

        Args:
            q, v: (n,).
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.
        """

    @kernel_method()
    def reactions(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        z: ArrayLike | None = None,
        cut: bool = False,
        out: Array | None = None,
    ) -> Array:
        """Return the wrench of each joint on its child link, (joints, 6): force (N), moment (N m) at the joint.

        In the axes of the joint's frame after its motion (z is the principal axis), at that frame's origin.  The
        joint's springs, dampers and drives are in it.  Springs between points act on the links, so that what
        they carry passes the joints by.  The cut joints of loops act on them, too, by the forces of
        ``loop_reactions``.

        Args:
            q, v, a: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            cut: of a robot with loops: compute the open tree, whose loops are cut.
            out: array to write to.

        Raises:
            LoopError: as of ``inverse_dynamics``.
        """

    @kernel_method()
    def loop_reactions(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        z: ArrayLike | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return the wrench that each loop's cut joint exerts on its second link, (loops, 6): force (N), moment (N m).

        At the origin and in the axes of the cut frame on that link; the first link feels the opposite.  Components
        that the joint leaves free are zero, elastic ones what their laws say.  Where constraints are redundant, those
        of them that rigid bodies do not determine have about the least norm.

        Args:
            q, v, a: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.

        Raises:
            LoopError: as of ``inverse_dynamics``.
            UnknownNameError: the robot has no loops.
        """


class KernelFunctions:
    """Methods of the same kind for forces of single parts, sensors and the constraint; see ``Functions``."""

    _bound: BoundFunctions

    @kernel_method()
    def external_force(self, q: ArrayLike, wrench: WrenchLike, *, out: Array | None = None) -> Array:
        """Return Q_F of eq. (14), its moment term corrected, (n,), N or N m, of wrenches in the base frame.

        Args:
            q: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            out: array to write to.
        """

    @kernel_method()
    def frame_velocities(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return velocities of frames, (frames, 6), in the base frame: of the origin (m/s), then angular (rad/s)."""

    @kernel_method()
    def frame_accelerations(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return accelerations of frames, (frames, 6), in the base frame: of origins (m/s^2), then angular (rad/s^2).

        Gravity is not in it: a frame at rest has none.
        """

    @kernel_method()
    def imu(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return what IMUs on all frames read, (frames, 6), each in its frame's axes.

        Of its accelerometer the specific force R^T (a - g), m/s^2, of its gyroscope the angular rate R^T w, rad/s: at
        rest it reads the acceleration that holds it against gravity.
        """

    @kernel_method()
    def measurement(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return readings of the robot's sensors, (readings,), in the order of ``eomgen.control.Measurement.names``."""

    @kernel_method()
    def generalized_momentum(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the generalized momentum p = M v and, below it, C^T v = dT/dq, (2, n).

        On a motion p' = u + C^T v + generalized_force(q, v) + external forces, which a momentum observer finds so.
        """

    @kernel_method()
    def regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return Y(q, v, a), (n, parameters): inverse dynamics without springs and dampers is Y theta, N or N m.

        The columns have the names ``regressor_names``: ten of each link that moves against its parent, with all that is
        fixed to it, then one of every armature.  Of a link they are m (kg), m c by x, y and z (kg m) and the inertia
        xx, xy, xz, yy, yz, zz (kg m^2) about the origin and along the axes of its frame, not about its centre of
        mass: "link1.m", "link1.mx", "link1.ixx"; products of inertia as in the description, minus the integral of x y.
        Columns of links that do not hang on a coordinate are zero in its row.  Of a robot with loops: of its open tree.
        Of a link that bends they are those of the link while nothing bends; what its modes need beside that is in no
        column.  A node of it has ten of its own: of what is fixed there, such as "arm_tip.m".
        """

    @kernel_method()
    def euler_cosines(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the cosine of beta of each joint with three angles, (joints,); 1 for other joints.

        At 0 the Euler angles are singular (beta = +-pi/2) and forward dynamics has no solution; near it,
        accelerations of alpha and gamma lose as many digits as the cosine has zeros.
        """

    @kernel_method()
    def constraint(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return g(q), (constraints,): zero where the loops are closed.

        Of frame b on a loop's second link, seen from frame a on its first: x, y, z (m) of its origin, and sines of its
        turns alpha, beta, gamma about x, y, z, as far as the cut joint blocks them (``eomgen.robot.cuts``).
        """

    @kernel_method()
    def constraint_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return J = dg/dq, (constraints, n), exact; J v is the rate of g."""

    @kernel_method()
    def constraint_bias(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return J_dot v, (constraints,): the second derivative of g is J a + J_dot v."""

    @kernel_method()
    def coupling_forces(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        z: ArrayLike | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return forces on the followers of ``couplings`` that a motion takes, (couplings,), N or N m.

        A coupling exerts it on its follower, and -ratio times as much on what that follows.

        Args:
            q, v, a: (n,).
            wrench: external wrenches, (links, 6), or by name; see ``Kernel``.
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.

        Raises:
            UnknownNameError: no rigid coupling makes followers of coordinates.
        """

    @kernel_method()
    def cut_poses(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the pose of frame b seen from frame a of each loop, (loops, 4, 4), m: the motion of the cut joint."""

    @kernel_method()
    def spring_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return length (m) and tension (N) of every point-to-point spring, (springs, 2), in the order of ``springs``.

        Tension is positive where the spring pulls its points together; dampers are in it.
        """

    @kernel_method()
    def spring_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return derivatives of the springs' lengths by q, (springs, n), m or m/rad: the tensions' moment arms.

        The springs' generalized force is minus its transpose times the tensions.
        """

    @kernel_method()
    def cut_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the deviation (m, rad) and resisting force (N, N m) of everything in ``cut_laws``, (cut_laws, 2).

        The deviation is that of the cut joint's coordinate (of the frame on its second link as seen from the first)
        from its offset, or of a coupled coordinate from what it is coupled to; dampers and friction are in the force.
        """

    @kernel_method()
    def cut_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return derivatives of the deviations in ``cut_forces`` by q, (cut_laws, n), in their units per m or rad.

        The generalized force is minus its transpose times the resisting forces.
        """

    @kernel_method()
    def element_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the value (m, rad) and resisting force (N, N m) of each of ``element_rows``, (element_rows, 2).

        The value is that of a coordinate of the frame on the second link as seen from that on the first; dampers are
        in the force.
        """

    @kernel_method()
    def element_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return derivatives of the values in ``element_forces`` by q, (element_rows, n), in their units per m or rad.

        The elements' generalized force is minus its transpose times the resisting forces.
        """

    @kernel_method("u")
    def drive_forces(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        z: ArrayLike | None = None,
        *,
        out: Array | None = None,
    ) -> Array:
        """Return the forces of all drives on coordinates, (n,), N or N m, where u means what ``inputs`` says.

        Args:
            q, v, u: (n,).
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.
        """

    @kernel_method()
    def drive_jacobian(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        *,
        z: ArrayLike | None = None,
        out: Array | None = None,
    ) -> tuple[Array, ...]:
        """Return derivatives by q, v and u of the forces of drives with states, and of the states' rates: three (n, n).

        Args:
            q, v, u: (n,).
            z: internal states of force laws, (m,), where there are some.
            out: array to write to.
        """

    @kernel_method()
    def spring_stiffness(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return an upper bound of the springs' stiffness matrix, (n, n), N/m, N or N m/rad; positive semidefinite.

        The sum of k D^T D, D the derivative by q of the vector between a spring's points, seen from the last link that
        moves both, k its stiffness in all directions: of a curve that of its steepest piece, of a cable as if taut.
        """
