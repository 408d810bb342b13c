"""The kernel: the NumPy interface of compiled equations of motion, with all methods."""

from __future__ import annotations

from .derivatives.by_arguments import Differentiation
from .derivatives.in_time import TimeDerivatives
from .inverse_kinematics.kernel_method import InverseKinematics
from .stepping.interface import Rollouts


class Kernel(Differentiation, TimeDerivatives, InverseKinematics, Rollouts):
    """Compiled equations of motion of one robot.

    Arrays are (n,) for one state, (N, n) for N states, or (..., n); the result gains the same leading axes.  Leading
    axes of several arrays go together as NumPy broadcasts, so that one state beside many stands for all of them.  SI
    units, radians; frames are the description's.  Coordinates are in the order of ``coordinates``.  Calls are
    re-entrant, release the GIL where they take long, and end soon after Ctrl-C.  Where the package has an extension
    module (``functions.is_direct``), methods with plain arrays go to the C without Python in between.

    Beside the equations of motion there are, in groups:

    - derivatives: ``forward_dynamics_jacobian``, ``residual_jacobian``, ``rollout_sensitivity``, ``close_series``;
    - copies and settings: ``replaced``, ``threads``, ``checks``;
    - the description: ``n``, ``home``, ``limits``, ``ratio``, ``regressor_names``, ``regressor_values``, ``blocks``;
    - ``functions``: all functions of the C, also those of springs, force elements, cut joints, constraints and sensors.

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
        couplings: names of the rigid couplings whose followers are no coordinates, in the order of
            ``functions.coupling_forces``; see ``followers``.
        follower_names: names of what these couplings move, each behind those that it follows itself.
        springs: names of the springs between two points, in the order of
            ``functions.spring_forces``.
        element_rows: names of the coordinates of other force elements between two links ("mount.x"), in the order of
            ``functions.element_forces``.
        cut_laws: names of the coordinates of cut joints that have a force ("pin4.x"), then of elastic couplings, in the
            order of ``functions.cut_forces``.
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
        functions: methods that call one function of C each, see ``Functions``.

    Raises (all methods):
        ArrayError: an array of wrong shape, with numbers that the dtype cannot hold exactly, or with NaN or infinity
            (see ``checks``); or a result that is not finite.
    """
