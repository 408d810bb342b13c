"""NumPy interface of a compiled module."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .arrays import flag, joint_lead
from .by_name import WrenchLike, wrench_rows
from .derivatives.by_arguments import Differentiation
from .derivatives.in_time import TimeDerivatives
from .inverse_kinematics.kernel_method import InverseKinematics
from .loop_errors import LOADED
from .raw import Array
from .stepping.interface import Rollouts


class Kernel(Differentiation, TimeDerivatives, InverseKinematics, Rollouts):
    """Compiled equations of motion of one robot.

    Arrays are (n,) for one state, (N, n) for N states, or (..., n); the result gains the same leading axes.  Leading
    axes of several arrays go together as NumPy broadcasts, so that one state beside many stands for all of them.  SI
    units, radians; frames are the description's.  Coordinates are in the order of ``coordinates``.  Calls are
    re-entrant, release the GIL where they take long, and end soon after Ctrl-C.  Where the package has an extension
    module (see ``is_direct``), methods with plain arrays go to the C without Python in between.

    Kernels can be copied and pickled, with separate parameters.  In another process the same package is loaded, or
    built where the cache there lacks it; a kernel of a generated package asks for that package by its name.

    Attributes:
        name: the robot's name.
        coordinates: names such as "joint1.x"; n of them.
        internal_states: names of the m internal states of force laws, such as "joint1.gamma.friction.z".  Methods whose
            results depend on them take them as z, (m,) or (..., m); it is required there, and refused where there are
            none.
        internal_state_units: their units, such as "rad".
        joints: names of the joints that move, in the order of ``reactions``.
        links: names of the links that move, in the order of ``wrench``.
        frames: names that ``frame_pose`` knows: frames, then links.
        loops: mapping from the names of the loops to the types of their cut joints.  Where there are loops, they are
            closed in ``forward_dynamics``, ``constraint_forces``, ``inverse_dynamics``, ``reactions``,
            ``loop_reactions``, ``forward_dynamics_jacobian`` and ``rollout``, of which some know the tree that is left
            when the loops are cut by ``cut=True``; all other methods are those of that tree.
        constraints: names of the constraint's components, such as "loop1.x".
        couplings: names of the rigid couplings whose followers are no coordinates, in the order of ``coupling_forces``;
            see ``followers``.
        follower_names: names of what these couplings move, each behind those that it follows itself.
        springs: names of the springs between two points, in the order of ``spring_forces``.
        element_rows: names of the coordinates of other force elements between two links ("mount.x"), in the order of
            ``element_forces``.
        cut_laws: names of the coordinates of cut joints that have a force ("pin4.x"), then of elastic couplings, in the
            order of ``cut_forces``.
        prescribed: names of the coordinates whose motion is prescribed, in their order.
        actuated_coordinates: names of the coordinates that have a drive, in their order.
        efforts: mapping from coordinates to limits of their drives' forces, N or N m, as the description has them.
        motors: mapping from the names of motors' coordinates to those of the principal coordinates that they drive.
        parameters: mapping from name to value; an assignment takes effect without recompiling.
        elements: places among the parameters of the numbers of forces, by family ("coordinates", "springs", ...), by
            what has them ("joint1.x"), and by their names in its table ("stiffness").
        knots: deviations (m, rad) of measured curves by coordinate, elongations (m) by spring; the forces there are
            parameters.
        operations: per kernel the multiplications, additions, divisions and sine-cosine pairs of its C; of one that was
            not asked for yet they are counted when they are looked up.
        dtype: the dtype of all arrays.
        raw: the functions of C as they are, for programs that call them without checks.
        calls: checked calls of those functions by their names.

    Raises (all methods):
        ArrayError: an array of wrong shape, with numbers that the dtype cannot hold exactly, or with NaN or infinity
            (see ``checks``); or a result that is not finite.
    """

    def mass_matrix(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the mass matrix M(q), (n, n), symmetric; eq. (11); kg, kg m or kg m^2 by its coordinates."""
        return self.calls.run("mass_matrix", out, (q,))

    def bias_force(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return Coriolis and centrifugal terms without gravity, (n,), N or N m: sum_vw C^svw v w of eq. (12).

        ``nonlinear_effects`` has gravity in it, as what MuJoCo and Featherstone call bias has.
        """
        return self.calls.run("bias_force", out, (q, v))

    def gravity(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return forces g(q) that hold the links' weight, (n,), N or N m, on the side of M a: tau = M a + C v + g.

        They come of the masses alone; springs and dampers are in ``generalized_force``.  Of a robot with loops: of its
        open tree.
        """
        return self.calls.run("gravity", out, (q,))

    def nonlinear_effects(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return C v + g, (n,), N or N m: ``bias_force`` and ``gravity`` together, which other libraries call the bias.

        Springs and dampers are in ``generalized_force``.  Of a robot with loops: of its open tree.
        """
        return self.calls.run("nonlinear_effects", out, (q, v))

    def generalized_force(
        self,
        q: ArrayLike,
        v: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return Q_P + Q_G, eqs. (13) and (14), (n,), N or N m; with wrenches Q_F, too.

        Args:
            q, v: coordinates and their rates, (n,).
            wrench: (links, 6), per link force (N) then moment (N m) about its centre of mass, base frame; or a mapping
                from frames and links to six numbers, (6,) or (..., 6), base frame: at a frame's origin, about a link's
                centre of mass.  Frames take kinematics.
            out: array to write to.
            z: internal states, (m,).
        """
        return self._loaded("generalized_force", out, (q, v), wrench, z)

    def residual(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        u: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return M a + bias - generalized_force - u, (n,), N or N m; zero on a motion.

        Args:
            q, v, a, u: (n,).
            wrench: as in ``generalized_force``.
            out: array to write to.
            z: internal states, (m,).
        """
        return self._loaded("residual", out, (q, v, a, u), wrench, z)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        cut: bool = False,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return the actuator forces u, (n,), N or N m, that make a motion: the residual is zero, but for loop forces.

        Of a robot with loops: M a + h = u + J^T lambda with u at the coordinates that have a drive alone, prescribed
        ones among them, and 0 elsewhere; of several possible drives the least by the sum of their squares.

        Args:
            q, v, a: (n,), a motion that keeps the loops closed.
            wrench: as in ``generalized_force``.
            out: array to write to.
            cut: of a robot with loops, that its loops are open: of the tree alone, at every coordinate.
            z: internal states, (m,).

        Raises:
            LoopError: a loop is open, opening, or opens at the accelerations, by more than 1e-9 (float32: 1e-5) m or
                rad (per second and the largest rate; per second squared and the largest acceleration); or these drives
                cannot make the motion.
        """
        return self._driving("inverse_dynamics", out, (q, v, a), wrench, cut=cut, z=z)

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        z: ArrayLike | None = None,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        cut: bool = False,
    ) -> Array:
        """Return accelerations, (n,), m/s^2 or rad/s^2, under the drives u.

        In ``u`` a prescribed coordinate has its acceleration, m/s^2 or rad/s^2, which the result repeats; the force
        that this takes is ``inverse_dynamics`` at the result.  Loops are closed.

        Args:
            q, v, u: (n,).
            z: internal states, (m,).
            wrench: as in ``generalized_force``.
            out: array to write to.
            cut: of a robot with loops, that its loops are open: of the tree alone.

        Raises:
            SingularError: M cannot be inverted in this state.
            LoopError: a loop is open, or opening, by more than 1e-9 (float32: 1e-5) m or rad (per second and the
                largest rate).
        """
        if wrench is not None and self.augmented is not self:
            joined = self.calls.join_arguments("forward_dynamics", (q, v, u), z)
            whole = self.augmented.forward_dynamics(*joined, wrench=wrench, cut=cut)
            return self.calls.arrays.written(self.calls.split(whole, "vector"), out)
        if wrench is not None:
            u = self._with_wrench(q, u, wrench)
        name = "forward_dynamics"
        return self.calls.run(self.calls.of_tree(name) if flag("cut", cut) else name, out, (q, v, u), z=z)

    def internal_state_derivatives(self, q: ArrayLike, v: ArrayLike, z: ArrayLike, u: ArrayLike | None = None) -> Array:
        """Return the time derivatives of internal states, (m,), in their units per s.

        Args:
            q, v: coordinates and their rates, (n,).
            z: internal states, (m,).
            u: drives, (n,); zeros by default.
        """
        drives = np.zeros(self.n, self.dtype) if u is None else u
        joined = self.calls.join_arguments("forward_dynamics", (q, v, drives), z)
        return np.ascontiguousarray(self.augmented.forward_dynamics(*joined)[..., self.n :])

    def constraint_forces(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return multipliers lambda of the constraint, (constraints,), N or N m: M a + h = u + J^T lambda.

        Behind them stand the forces of ``couplings``, which hold what is no coordinate (see ``coupling_forces``).
        They are the forces that the loops' cut joints exert on their second links.  Where constraints are redundant,
        those of them that rigid bodies do not determine have the least norm, weighted by the diagonal of J M^-1 J^T.

        Args:
            q, v, u: (n,), as in ``forward_dynamics``.
            wrench: as in ``generalized_force``.
            out: array to write to.
            z: internal states, (m,).

        Raises:
            SingularError, LoopError: as of ``forward_dynamics``.
            UnknownNameError: the robot has no loops or rigid couplings.
        """
        if wrench is not None and self.augmented is not self:
            joined = self.calls.join_arguments("forward_dynamics", (q, v, u), z)
            return self.calls.arrays.written(self.augmented.constraint_forces(*joined, wrench=wrench), out)
        under = u if wrench is None else self._with_wrench(q, u, wrench)
        if not self.couplings:
            return self.calls.run("constraint_forces", out, (q, v, under), z=z)
        a = self.forward_dynamics(q, v, under, z)
        forces = self.coupling_forces(q, v, a, wrench=wrench, z=z)
        if self.constraints:
            forces = np.concatenate([self.calls.run("constraint_forces", None, (q, v, under), z=z), forces], axis=-1)
        return self.calls.arrays.written(forces, out)

    def coupling_forces(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return forces on the followers of ``couplings`` that a motion takes, (couplings,), N or N m.

        A coupling exerts it on its follower, and -ratio times as much on what that follows.

        Args:
            q, v, a: (n,).
            wrench: as in ``generalized_force``.
            out: array to write to.
            z: internal states, (m,).

        Raises:
            UnknownNameError: no rigid coupling makes followers of coordinates.
        """
        return self._loaded("coupling_forces", out, (q, v, a), wrench, z)

    def _loaded(
        self,
        name: str,
        out: Array | None,
        values: tuple[ArrayLike, ...],
        wrench: WrenchLike | None,
        z: ArrayLike | None,
    ) -> Array:
        """Compute a function of q and more with what wrenches add to it."""
        return self.calls.run_with_wrench(name, out, values, wrench_rows(self.calls, values[0], wrench), z)

    def _with_wrench(self, q: ArrayLike, u: ArrayLike, wrench: WrenchLike) -> Array:
        """Return drives with the generalized forces of wrenches; of a prescribed coordinate its acceleration."""
        external = self.external_force(q, wrench)
        drives, lead = self.calls.array("u", u, external.shape[-1:])
        joint_lead("u", lead, external.shape[:-1])
        external[..., self._given] = 0  # where u is an acceleration
        return self.calls.arrays.beside_drives(drives, external)

    def drive_forces(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, z: ArrayLike | None = None, *, out: Array | None = None
    ) -> Array:
        """Return the forces of all drives on coordinates, (n,), N or N m, where u means what ``inputs`` says.

        Args:
            q, v, u: (n,).
            z: internal states, (m,).
            out: array to write to.
        """
        if not self.calls.arrays.has_drives:
            return self.calls.arrays.written(self._undriven(q, v, u, z), out)
        return self.calls.run("drive_forces", out, (q, v, u), z=z)

    def _undriven(self, q: ArrayLike, v: ArrayLike, u: ArrayLike, z: ArrayLike | None) -> Array:
        """Return u, which is the forces where no drive takes it otherwise."""
        lead: tuple[int, ...] = ()
        for label, value, states in (("q", q, None), ("v", v, z), ("u", u, None)):
            joined = self.calls.join(label, value, states)
            array, own = self.calls.augmented.array(label, joined, (self.augmented.n,))
            lead = joint_lead(label, own, lead)
        return self.calls.split(np.array(np.broadcast_to(array, (*lead, self.augmented.n))), "vector")

    def euler_cosines(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the cosine of beta of each joint with three angles, (joints,); 1 for other joints.

        At 0 the Euler angles are singular (beta = +-pi/2) and forward dynamics has no solution; near it,
        accelerations of alpha and gamma lose as many digits as the cosine has zeros.
        """
        return self.calls.run("euler_cosines", out, (q,))

    def external_force(self, q: ArrayLike, wrench: WrenchLike, *, out: Array | None = None) -> Array:
        """Return Q_F of eq. (14), its moment term corrected, (n,), N or N m, of wrenches in the base frame.

        Args:
            q: (n,).
            wrench: as in ``generalized_force``.
            out: array to write to.
        """
        rows = wrench_rows(self.calls, q, wrench)
        assert rows is not None
        return self.calls.run("external_force", out, (q, rows))

    def coriolis_matrix(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the Coriolis matrix C(q, v), (n, n), by Christoffel symbols: C v = bias, M_dot = C + C^T."""
        return self.calls.run("coriolis_matrix", out, (q, v))

    def christoffel(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return Christoffel symbols of the first kind, (n, n, n): C^svw of eq. (12), symmetric in the last two."""
        return self.calls.run("christoffel", out, (q,))

    def energy(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None, z: ArrayLike | None = None) -> Array:
        """Return (kinetic, potential) energy, (2,), J: eq. (4); gravity (zero at the base's origin), springs, states z.

        Args:
            q, v: (n,).
            out: array to write to.
            z: internal states, (m,).
        """
        return self.calls.run("energy", out, (q, v), z=z)

    def reactions(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        cut: bool = False,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return the wrench of each joint on its child link, (joints, 6): force (N), moment (N m) at the joint.

        In the axes of the joint's frame after its motion (z is the principal axis), at that frame's origin.  The
        joint's springs, dampers and drives are in it.  Springs between points act on the links, so that what
        they carry passes the joints by.  The cut joints of loops act on them, too, by the forces of
        ``loop_reactions``.

        Args:
            q, v, a: (n,).
            wrench: external wrenches as in ``generalized_force``.
            out: array to write to.
            cut: of a robot with loops, that its loops are open: no force passes through them.
            z: internal states, (m,).

        Raises:
            LoopError: as of ``inverse_dynamics``.
        """
        return self._driving("reactions", out, (q, v, a), wrench, cut=cut, z=z)

    def regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Return Y(q, v, a), (n, parameters): inverse dynamics without springs and dampers is Y theta, N or N m.

        The columns have the names ``regressor_names``: ten of each link that moves against its parent, with all that is
        fixed to it, then one of every armature.  Of a link they are m (kg), m c by x, y and z (kg m) and the inertia
        xx, xy, xz, yy, yz, zz (kg m^2) about the origin and along the axes of its frame, not about its centre of
        mass: "link1.m", "link1.mx", "link1.ixx"; products of inertia as in the description, minus the integral of x y.
        Columns of links that do not hang on a coordinate are zero in its row.  Of a robot with loops: of its open tree.
        Of a link that bends they are those of the link while nothing bends; what its modes need beside that is in no
        column.  A node of it has ten of its own: of what is fixed there, such as "arm_tip.m".

        Args:
            q, v, a: (n,).
            out: array to write to.
        """
        return self.calls.run("regressor", out, (q, v, a))

    def loop_reactions(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return the wrench that each loop's cut joint exerts on its second link, (loops, 6): force (N), moment (N m).

        At the origin and in the axes of the cut frame on that link; the first link feels the opposite.  Components
        that the joint leaves free are zero, elastic ones what their laws say.  Where constraints are redundant, those
        of them that rigid bodies do not determine have about the least norm.

        Args:
            q, v, a: (n,), a motion that keeps the loops closed, made by drives at the coordinates that have one.
            wrench: as in ``generalized_force``.
            out: array to write to.
            z: internal states, (m,).

        Raises:
            LoopError: as of ``inverse_dynamics``.
            UnknownNameError: the robot has no loops.
        """
        if wrench is None or not self.constraints:
            return self.calls.run("loop_reactions", out, (q, v, a), z=z)
        return self.calls.run("loop_reactions_under_load", out, (q, v, a, self.external_force(q, wrench)), z=z)

    def _driving(
        self,
        name: str,
        out: Array | None,
        values: tuple[ArrayLike, ...],
        wrench: WrenchLike | None,
        *,
        cut: bool,
        z: ArrayLike | None,
    ) -> Array:
        """Compute what a motion takes, with its loops closed or cut; see ``Calls.run_with_wrench``."""
        if flag("cut", cut) or not self.constraints:
            return self._loaded(self.calls.of_tree(name), out, values, wrench, z)
        if wrench is None:
            return self.calls.run(name, out, values, z=z)
        under = (*values, self.external_force(values[0], wrench))
        if name != "reactions":
            return self.calls.run(f"{name}{LOADED}", out, under, z=z)
        return self._loaded(f"{name}{LOADED}", out, under, wrench, z)

    def spring_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return length (m) and tension (N) of every point-to-point spring, (springs, 2), in the order of ``springs``.

        Tension is positive where the spring pulls its points together; dampers are in it.
        """
        return self.calls.run("spring_forces", out, (q, v))

    def spring_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return derivatives of the springs' lengths by q, (springs, n), m or m/rad: the tensions' moment arms.

        The springs' generalized force is minus its transpose times the tensions.
        """
        return self.calls.run("spring_jacobian", out, (q,))

    def element_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the value (m, rad) and resisting force (N, N m) of each of ``element_rows``, (element_rows, 2).

        The value is that of a coordinate of the frame on the second link as seen from that on the first; dampers are
        in the force.
        """
        return self.calls.run("element_forces", out, (q, v))

    def element_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return derivatives of the values in ``element_forces`` by q, (element_rows, n), in their units per m or rad.

        The elements' generalized force is minus its transpose times the resisting forces.
        """
        return self.calls.run("element_jacobian", out, (q,))

    def cut_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the deviation (m, rad) and resisting force (N, N m) of everything in ``cut_laws``, (cut_laws, 2).

        The deviation is that of the cut joint's coordinate (of the frame on its second link as seen from the first)
        from its offset, or of a coupled coordinate from what it is coupled to; dampers and friction are in the force.
        """
        return self.calls.run("cut_forces", out, (q, v))

    def cut_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return derivatives of the deviations in ``cut_forces`` by q, (cut_laws, n), in their units per m or rad.

        The generalized force is minus its transpose times the resisting forces.
        """
        return self.calls.run("cut_jacobian", out, (q,))

    def spring_stiffness(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return an upper bound of the springs' stiffness matrix, (n, n), N/m, N or N m/rad; positive semidefinite.

        The sum of k D^T D, D the derivative by q of the vector between a spring's points, seen from the last link that
        moves both, k its stiffness in all directions: of a curve that of its steepest piece, of a cable as if taut.
        """
        return self.calls.run("spring_stiffness", out, (q,))
