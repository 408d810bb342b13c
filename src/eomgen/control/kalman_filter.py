"""Extended Kalman filters of robots: states, wrenches and parameters estimated from measurements, step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..codegen.kernels.groups import (
    CLOSURE_BY_PARAMETERS,
    FILTER_BY_SENSITIVITIES,
    FILTER_OF_LINEAR_LAWS,
    FILTERED_ACCELERATIONS,
    FILTERED_ACCELERATIONS_BY_PARAMETERS,
    FILTERED_SENSORS,
    FILTERED_WRENCHES,
    INDEPENDENT_COORDINATES,
    INVERSE_DYNAMICS,
    SENSORS,
    SLOPES_OF_CLOSURE,
    kernel_group,
)
from ..description import RobotLike
from ..errors import InputError, IntegrationError, LoopError, UnknownNameError
from ..identifiers import check_kind, word_in
from ..kernel.complete import Kernel
from ..limits import LARGEST, MOST_COUNTED, is_usable
from ..names import component_name, nearest_or_all, show
from ..pipeline.building import build
from ..robot.model import Model, build_model
from ..robot.parameter_names import leasts
from ..robot.value import Sensor
from ..runtime.arrays import joint_lead, names_in, numbers_in
from .covariances import Covariance, SquareRoot
from .filter_coordinates import AllCoordinates, FilterCoordinates, IndependentCoordinates
from .filter_steps import Acting, FilterSteps, Slopes, names_linear_laws
from .independent import Independent
from .observability import HORIZON, Observability, common_observability
from .sensing import Measurement

Numbers = NDArray[Any]
Form = Literal["covariance", "square_root"]
FORMS: tuple[str, ...] = get_args(Form)
WRENCH = "wrench:"  # begins the name of a state that is a wrench on a link
WRENCHES = ("fx", "fy", "fz", "mx", "my", "mz")
POSE_SEED, POSES_APART, DEFLECTED = (
    41,
    0.3,
    1e-3,
)  # of the state about which observability is looked at; rad or m, rad/s
LEAST = 1e-3  # of a described parameter: what remains of an estimate that may not be below 0
PER_COORDINATE = ("position", "velocity", "acceleration")  # fields that may have a number for each coordinate
NEARER = 6  # times that it is halved where loops do not close so far from the home


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Uncertainty of a filter's states at the beginning, and noise that moves them beside the equations of motion.

    Standard deviations at the beginning, and densities of white noise per root of a second; SI units, rad.

    position, velocity: of coordinates, one number or one for each.
    acceleration: density that disturbs accelerations, (rad/s or m/s) per root of a second.
    wrench, wrench_drift: of forces and moments that are states, N or N m.
    parameter, parameter_drift: of parameters that are states, as shares of their values (of those that are 0 absolute).
    bias: of sensors whose bias is a state; its drift stands in the measurement.
    """

    position: float | Sequence[float] = 1e-2
    velocity: float | Sequence[float] = 0.1
    acceleration: float | Sequence[float] = 0.1
    wrench: float = 10.0
    wrench_drift: float = 10.0
    parameter: float = 0.1
    parameter_drift: float = 0.0
    bias: float = 0.1

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            least = 0.0 if each.name.endswith(("drift", "acceleration")) else np.nextafter(0.0, 1.0)
            several = isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)
            numbers = list(value) if several and each.name in PER_COORDINATE else [value]
            if not numbers or not all(is_usable(x) and x >= least for x in numbers):
                raise InputError(
                    f"uncertainty: {each.name} is {show(value)}; allowed: above 0 (of noise, 0), up to {LARGEST:g}"
                )

    def of_coordinates(self, name: str, n: int) -> Numbers:
        """Return one number for each coordinate, (n,), of the field of that name; InputError of another count."""
        value = np.asarray(getattr(self, word_in("name", name, PER_COORDINATE)), float)
        check_kind("n", n, type(n) is int and 0 <= n <= MOST_COUNTED, "a number of coordinates")
        if value.ndim and value.shape != (n,):
            raise InputError(f"uncertainty: {name} has {value.size} numbers; allowed: one, or {n}, one per coordinate")
        return np.array(np.broadcast_to(value, (n,)))


@dataclass(frozen=True)
class FilterModel:
    """All that a filter is made of, for Python and for C.

    Attributes:
        measurement: sensors and their noise.
        model: of the robot.
        dt: s.
        links: names of the links whose wrenches are states.
        parameters: names of those that are states.
        form: one of FORMS.
        dtype: of all numbers.
        uncertainty: see Uncertainty.
        independent: which coordinates of a closed mechanism are estimated; None of a tree: all are.
    """

    measurement: Measurement
    dt: float
    links: tuple[str, ...]
    parameters: tuple[str, ...]
    form: str
    dtype: str
    uncertainty: Uncertainty
    independent: Independent | None = None
    model: Model = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "model", build_model(self.measurement.robot))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that are estimated, f: all, of a closed mechanism the independent ones."""
        names = self.model.coordinates
        return names if self.independent is None else tuple(names[i] for i in self.independent.free)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: positions, velocities, wrenches, parameters, biases."""
        names = self.coordinates
        wrenches = (component_name(f"{WRENCH}{link}", x) for link in self.links for x in WRENCHES)
        return (*names, *(f"d/dt {x}" for x in names), *wrenches, *self.parameters, *self.biases)

    @property
    def biases(self) -> tuple[str, ...]:
        """Names of biases that are states."""
        return tuple(f"bias of {self.measurement.innovations[i][0]}" for i in self.measurement.biased)

    def deviations(self) -> Numbers:
        """Return standard deviations of the states at the beginning, (N,)."""
        known, n = self.uncertainty, len(self.coordinates)
        shares = [known.parameter * (abs(self.model.parameters[x]) or 1.0) for x in self.parameters]
        parts = (known.of_coordinates("position", n), known.of_coordinates("velocity", n))
        rest = [known.wrench] * (6 * len(self.links)) + shares + [known.bias] * len(self.biases)
        return np.concatenate([*parts, rest])

    def least(self) -> Numbers:
        """Return what estimates of parameters are projected onto from below, (p,); -inf where any number will do.

        It is LEAST of the way from the least value that is allowed to the described one, so that a mass stays above 0.
        """
        bounds = leasts(self.measurement.robot, self.parameters)
        own = [(bounds.get(x, -np.inf), self.model.parameters[x]) for x in self.parameters]
        return np.array([low + LEAST * max(described - low, 0.0) if low > -np.inf else low for low, described in own])

    def noise(self) -> Numbers:
        """Return standard deviations that a step adds to each state, (N,); those of velocities move positions, too."""
        known, n = self.uncertainty, len(self.coordinates)
        shares = [known.parameter_drift * (abs(self.model.parameters[x]) or 1.0) for x in self.parameters]
        biases = [self.measurement.drift[i] for i in self.measurement.biased]
        rest = [known.wrench_drift] * (6 * len(self.links)) + shares + biases
        whole = np.concatenate([np.zeros(n), known.of_coordinates("acceleration", n), np.array(rest, float)])
        return np.asarray(np.sqrt(self.dt) * whole)


class Observer:
    """An extended Kalman filter of a robot, by exact derivatives of linearly implicit steps.

    Attributes:
        filter: what it is made of.
        kernel: of the robot, with the parameters that are estimated.
        states: names of the states, N.
        measured: names of the innovations, m.
        state: estimate of q, v, wrenches, parameters and biases, (N,); of a closed mechanism q and v of its independent
            coordinates, f of n, which the others follow.
        normalized_innovation: of the last update, (m,): independent numbers of variance 1 where noise is as told.
        at_bounds: names of the parameters that the last update would have moved below their least values: estimates
            are projected onto these, and variances stay.
    """

    def __init__(self, model: FilterModel, steps: FilterSteps) -> None:
        """Begin at the described home, at rest, with the described parameters."""
        check_kind("model", model, isinstance(model, FilterModel), "a model that observer makes")
        check_kind("steps", steps, isinstance(steps, FilterSteps), "steps that observer makes")
        self.filter, self.kernel, self._steps = model, steps.kernel, steps
        self._f, self._coordinates = len(model.coordinates), steps.coordinates
        self.states, dtype = model.states, steps.kernel.dtype
        self.measured = tuple(name for name, _ in model.measurement.innovations)
        self._nominal = [model.model.parameters[x] for x in model.parameters]
        self._deviations = np.array(model.measurement.noise, dtype)
        self._noise, self._least = model.noise().astype(dtype), model.least().astype(dtype)
        self.at_bounds: tuple[str, ...] = ()
        self._bias_rows = list(model.measurement.biased)
        self.normalized_innovation: Numbers = np.zeros(len(self.measured), dtype)
        self._u = np.zeros(steps.kernel.n, dtype)
        self.state: Numbers = np.zeros(len(self.states), dtype)
        self._uncertain: Covariance | SquareRoot
        self.begin(np.asarray(model.model.home), np.zeros(steps.kernel.n))

    def begin(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Begin anew at q and v, (n,) each (at rest), with the uncertainty of the beginning.

        Of a closed mechanism independent coordinates and velocities are those given, and the others follow near q.

        Raises:
            InputError: another shape, or no numbers.
            LoopError: the loops do not close near q.
            SingularError: the independent coordinates do not hold the others there.
        """
        n, dtype = self.kernel.n, self.kernel.dtype
        rest = np.zeros(len(self.states) - 2 * self._f)
        at = 6 * len(self.filter.links)
        rest[at : at + len(self._nominal)] = self._nominal
        begins = self._placed(_vector("q", q, n), _vector("v", np.zeros(n) if v is None else v, n))
        self.state = np.concatenate([begins, rest]).astype(dtype)
        form = SquareRoot if self.filter.form == "square_root" else Covariance
        self._uncertain = form.of(self.filter.deviations().astype(dtype))
        self._write_parameters(self.state)

    @property
    def is_linear(self) -> bool:
        """Whether stiffness and damping are constant, so that a step's derivatives follow from the residual's."""
        return self._steps.slopes is not None

    @property
    def q(self) -> Numbers:
        """Estimated coordinates, (n,)."""
        return self._coordinates.state(self.state[: 2 * self._f])[0]

    @property
    def v(self) -> Numbers:
        """Estimated velocities, (n,)."""
        return self._coordinates.state(self.state[: 2 * self._f])[1]

    @property
    def covariance(self) -> Numbers:
        """Covariance of the state, (N, N)."""
        return self._uncertain.covariance

    def estimate(self, name: str) -> float:
        """Return the estimate of a state by its name.

        Raises:
            UnknownNameError: no such state.
        """
        if not isinstance(name, str) or name not in self.states:
            raise UnknownNameError(f"observer: {show(name)} is no state{nearest_or_all(name, self.states)}")
        return float(self.state[self.states.index(name)])

    def predict(self, u: ArrayLike) -> None:
        """Go on by a step of dt under the drives u, (n,), held over it; an error leaves the estimate as it was.

        Raises:
            InputError: another shape, or no numbers.
            SingularError, IntegrationStopped: as of ``Kernel.rollout``.
            IntegrationError: the estimate or its covariance is not finite after the step.
            LoopError: the loops of a closed mechanism do not close at the estimate.
        """
        held = _vector("u", u, self.kernel.n).astype(self.kernel.dtype)
        with _computing("u", held):
            end, by = self._steps.advance(self.q, self.v, self._acting(held))
            uncertain = self._uncertain.carried(*self.transition(by))
        _check_finite("u", held, end, uncertain)
        self._coordinates.state(end)
        self._u, self._uncertain = held, uncertain
        self.state = np.concatenate([end, self.state[2 * self._f :]]).astype(self.kernel.dtype)

    def update(self, y: ArrayLike) -> float:
        """Take readings y of the sensors, (readings,), and return the sum of squares of normalized innovations.

        It is about as large as the number of innovations where the noise is as told (chi-square).  An error leaves the
        estimate as it was.

        Raises:
            InputError: another shape, or no numbers.
            IntegrationError: the estimate or its covariance is not finite after the readings, or the covariance is not
                positive any more, by round-off, in the form "covariance".
            LoopError: the loops of a closed mechanism do not close at the estimate.
        """
        readings = _vector("y", y, len(self.filter.measurement.readings))
        with _computing("y", readings):
            predicted, H = self.predicted()
            innovation = self.filter.measurement.innovation(readings, predicted)
            innovation[self._bias_rows] -= self.state[len(self.states) - len(self._bias_rows) :]
            known = innovation.astype(self.kernel.dtype)
            uncertain, change, normalized = self._uncertain.measured(H, self._deviations, known)
            state, squares = self.state + change, float(normalized @ normalized)
        _check_finite("y", readings, [*state, squares], uncertain)
        places = slice(2 * self._f + 6 * len(self.filter.links), len(self.states) - len(self._bias_rows))
        below = state[places] < self._least
        state[places] = np.where(below, self._least, state[places])
        self._write_parameters(state)
        try:
            self._coordinates.state(state[: 2 * self._f])
        except InputError:
            self._write_parameters(self.state)
            raise
        self.at_bounds = tuple(np.array(self.filter.parameters, dtype=object)[below].tolist())
        self.state, self._uncertain, self.normalized_innovation = state, uncertain, normalized
        return squares

    def transition(self, by: Numbers) -> tuple[Numbers, Numbers]:
        """Return the transition matrix F, (N, N), and the noise's columns G, (N, N), from derivatives of q and v.

        Raises:
            InputError: derivatives of another shape, or no numbers.
        """
        f, N, dtype = self._f, len(self.states), self.kernel.dtype
        dt, noise = dtype.type(self.filter.dt), np.diag(self._noise)
        shape = (2 * f, self._steps.size)
        slopes = numbers_in("by", by, f"numbers of shape {shape}", finite=False)
        if slopes.shape != shape:
            raise InputError(f"by: got the shape {slopes.shape}; allowed: {shape}")
        F = np.eye(N, dtype=dtype)
        F[: 2 * f, : self._steps.size] = slopes
        noise[:f] += dt * noise[f : 2 * f]
        return F, noise

    def predicted(self) -> tuple[Numbers, Numbers]:
        """Return expected readings without biases, (readings,), and derivatives of innovations by the state, (m, N)."""
        measurement, kernel, n = self.filter.measurement, self.kernel, self.kernel.n
        q, v, f, N = self.q, self.v, self._f, len(self.states)
        a, by = np.zeros(n, kernel.dtype), np.zeros((n, self._steps.size), kernel.dtype)
        if measurement.depends_on_acceleration:
            a, by = self._steps.accelerations(q, v, self._acting(self._u))
        predicted = kernel.functions.measurement(q, v, a)
        H_q, H_v, H_a = measurement.jacobian(kernel, q, v, a)
        H = np.zeros((len(self.measured), N), kernel.dtype)
        H[:, : self._steps.size] = H_a @ by
        along_q, along_v = self._coordinates.directions(q, v)
        H[:, : 2 * f] += H_q @ along_q.T + H_v @ along_v.T
        weights = measurement.weights(predicted).astype(kernel.dtype)
        for i, name in enumerate(self.filter.parameters):
            still = (np.zeros(n, kernel.dtype),) * 3
            moved = kernel.jvp(kernel.functions.measurement, (q, v, a), still, parameters={name: 1.0})
            H[:, 2 * f + 6 * len(self.filter.links) + i] += weights @ moved
        for i, row in enumerate(self._bias_rows):
            H[row, N - len(self._bias_rows) + i] = 1.0
        return predicted, H

    def observability(
        self, q: ArrayLike | None = None, v: ArrayLike | None = None, *, horizon: float = HORIZON
    ) -> Observability:
        """Return how well measurements show the states, linearized about states q and v.

        Args:
            q, v: (n,) or (poses, n); without q near the home, with nothing special: drives turned, all moving.
            horizon: time of the measurements, s, of which several poses have equal shares, one after the other.

        Raises:
            InputError: arrays of other shapes, or a time that is no number above 0.
            LoopError: the loops do not close near a state.
        """
        if not (is_usable(horizon) and horizon > 0.0):
            raise InputError(f"horizon: {show(horizon)} s; allowed: a time above 0, up to {LARGEST:g}")
        n, kept, u = self.kernel.n, self.state, self._u
        before = self.q
        states = [self._generic()] if q is None else list(zip(*_rows(q, v, n), strict=True))
        systems = []
        try:
            for here, rate in states:
                self.state = np.concatenate([self._placed(here, rate), kept[2 * self._f :]]).astype(self.kernel.dtype)
                _, H = self.predicted()
                by = self._steps.advance(self.q, self.v, self._acting(self._u))[1]
                systems.append((self.transition(by)[0], H))
        finally:
            self.state, self._u = kept, u
            self._placed(before, np.zeros(n))
        scale, noise = self.filter.deviations(), self._deviations.astype(float)
        return common_observability(self.states, systems, scale, noise, dt=self.filter.dt, horizon=horizon)

    def _generic(self) -> tuple[Numbers, Numbers]:
        """Return q and v, (n,) each, near the home and with nothing special, where loops close."""
        rng, n, model = np.random.default_rng(POSE_SEED), self.kernel.n, self.filter.model
        size = np.full(n, DEFLECTED)
        size[list(model.driven)] = POSES_APART
        apart, rate, home = size * rng.normal(size=n), size * rng.normal(size=n), np.asarray(model.home)
        for halved in range(NEARER):
            q = home + 0.5**halved * apart
            try:
                self._placed(q, rate)
            except LoopError:
                continue
            return q, rate
        return home, rate

    def _placed(self, q: Numbers, v: Numbers) -> Numbers:
        """Return the states that q and v are, (2 f,); dependent coordinates follow near q from here on."""
        if isinstance(self._coordinates, IndependentCoordinates):
            return self._coordinates.begin(q, v)
        return np.concatenate([q, v])

    def _acting(self, u: Numbers) -> Acting:
        f, links = self._f, self._steps.links
        wrench = np.zeros((len(self.kernel.links), 6), self.kernel.dtype)
        wrench[list(links)] = self.state[2 * f : 2 * f + 6 * len(links)].reshape(-1, 6)
        return Acting(u, wrench)

    def _write_parameters(self, state: Numbers) -> None:
        """Let the kernel have a state's parameters: all or, where one cannot be, none."""
        at = 2 * self._f + 6 * len(self.filter.links)
        self.kernel.parameters.update({name: float(state[at + i]) for i, name in enumerate(self.filter.parameters)})


def observer(
    robot: RobotLike,
    measure: str | Sequence[str | Sensor] | Measurement,
    *,
    dt: float,
    states: Sequence[str] = (),
    uncertainty: Uncertainty | None = None,
    form: Form = "square_root",
    dtype: str = "float64",
    unobservable: Literal["refuse", "allow"] = "refuse",
) -> Observer:
    """Return an extended Kalman filter of a robot: ``predict(u)`` goes on by a step, ``update(y)`` takes readings.

    Its states are q and v, then wrenches on links and run-time parameters that drift.  Steps are linearly implicit, as
    of ``Kernel.rollout(method="implicit")``, so stiff joints need no shorter ones, and their derivatives are exact.
    Of a closed mechanism q and v of independent coordinates are states, driven ones as far as they can be.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; without internal states, prescribed
            coordinates and joints with 3-DOF rotation.
        measure: sensors, "encoder:joint1.gamma,imu:tcp", or a Measurement with its noise.
        dt: length of a step, s.
        states: further states: parameters by their names, "wrench:LINK" for force and moment on its center of mass.
        uncertainty: of the beginning and of the noise; by default Uncertainty().
        form: "square_root", which keeps a covariance positive in float32, too, or "covariance", which costs less.
        dtype: "float64" or "float32".
        unobservable: what is done where measurements do not tell all states: "refuse", or "allow".

    Raises:
        InputError: a robot, number or sensor that cannot be used, or states that measurements do not tell, by name.
        UnknownNameError: no such parameter or link.
        LoopError: loops do not close near the described home.
        BuildError: see ``build``.
    """
    model = filter_model(robot, measure, dt=dt, states=states, uncertainty=uncertainty, form=form, dtype=dtype)
    word_in("unobservable", unobservable, ("refuse", "allow"))
    made = Observer(model, steps_of(model))
    if unobservable == "refuse":
        told = made.observability()
        if not told.is_complete:
            raise InputError(
                f"observer of {model.model.name}: {told.message()}; allowed: further sensors, or fewer states"
            )
    return made


def filter_model(
    robot: RobotLike,
    measure: str | Sequence[str | Sensor] | Measurement,
    *,
    dt: float,
    states: Sequence[str] = (),
    uncertainty: Uncertainty | None = None,
    form: str = "square_root",
    dtype: str = "float64",
) -> FilterModel:
    """Return what a filter is made of; arguments and errors as of ``observer``."""
    measurement = measure if isinstance(measure, Measurement) else Measurement.of(robot, measure)
    if not (is_usable(dt) and dt > 0.0):
        raise InputError(f"dt: {show(dt)} s; allowed: a time above 0, up to {LARGEST:g}")
    word_in("form", form, FORMS)
    fits = uncertainty is None or isinstance(uncertainty, Uncertainty)
    check_kind("uncertainty", uncertainty, fits, "an Uncertainty, or None")
    model = build_model(measurement.robot)
    _refuse_what_filters_lack(model)
    links, parameters = list[str](), list[str]()
    for name in names_in("states", states):
        is_wrench = name.startswith(WRENCH)
        known = model.links if is_wrench else tuple(model.parameters)
        key = name.removeprefix(WRENCH) if is_wrench else name
        if key not in known:
            what = "link that moves" if is_wrench else "parameter, nor a wrench, wrench:LINK"
            raise UnknownNameError(f"states: {show(key)} is no {what}{nearest_or_all(key, known)}")
        (links if is_wrench else parameters).append(key)
    for names in (links, parameters):
        twice = [x for x in names if names.count(x) > 1]
        if twice:
            raise InputError(f"states: {twice[0]} stands twice; allowed: every state once")
    if links:
        _refuse_torques_under_load(measurement)
    chosen = _independent(model, parameters) if model.constraints else None
    return FilterModel(
        measurement, float(dt), tuple(links), tuple(parameters), form, dtype, uncertainty or Uncertainty(), chosen
    )


def _independent(model: Model, parameters: Sequence[str]) -> Independent:
    """Return which coordinates of a closed mechanism are independent about its home.

    Raises:
        InputError: a parameter that is estimated moves the dependent coordinates.
        LoopError: the loops do not close near the home.
    """
    slopes = CLOSURE_BY_PARAMETERS if parameters else ()
    kernel = build(model.robot, kernels=kernel_group(model, INDEPENDENT_COORDINATES, slopes))
    rng = np.random.default_rng(POSE_SEED)
    for name in parameters:
        for q in rng.normal(size=(3, kernel.n)):
            if kernel.jvp(kernel.functions.constraint, (q,), (np.zeros(kernel.n),), parameters={name: 1.0}).any():
                raise InputError(
                    f"states: {name} changes how the loops of {model.name} close; allowed: parameters of forces and"
                    " masses"
                )
    return Independent.of(kernel, kernel.assemble(np.asarray(model.home)), model.driven)


def _refuse_what_filters_lack(model: Model) -> None:
    """Refuse robots whose states are not coordinates and velocities that move under forces."""
    lacks = {
        "internal states": model.internal_states,
        "prescribed coordinates": model.prescribed,
        "joints with 3-DOF rotation": model.turning,
    }
    for what, names in lacks.items():
        if names:
            raise InputError(f"observer of {model.name}: it has {what}; allowed: robots without them")


def _refuse_torques_under_load(measurement: Measurement) -> None:
    """Refuse sensors of what joints carry beside wrenches, which they carry, too."""
    for sensor in measurement.sensors:
        if sensor.kind == "torque" and not sensor.of.endswith(".motor"):
            raise InputError(
                f"states: wrenches act beside {sensor.name}, whose reading is without them; allowed: torques of elastic"
                " gears (torque:JOINT.motor), or other sensors"
            )


def steps_of(model: FilterModel) -> FilterSteps:
    """Return a filter's steps, with a kernel that is built for them."""
    links = tuple(model.model.links.index(x) for x in model.links)
    further = not links and not model.parameters and model.independent is None
    if further and names_linear_laws(model.model):
        kernel = build(model.measurement.robot, kernels=kernels_of(model, is_linear=True), dtype=model.dtype)
        slopes = Slopes.of(kernel)
        if slopes.describe(kernel, model.dt):
            coordinates = AllCoordinates(model.model.size)
            return FilterSteps(kernel.replaced(), coordinates, model.dt, links, (), slopes)
    kernel = build(model.measurement.robot, kernels=kernels_of(model, is_linear=False), dtype=model.dtype)
    kernel = kernel.replaced()
    return FilterSteps(kernel, _coordinates(model, kernel), model.dt, links, model.parameters, None)


def _coordinates(model: FilterModel, kernel: Kernel) -> FilterCoordinates:
    chosen = model.independent
    return AllCoordinates(model.model.size) if chosen is None else IndependentCoordinates(kernel, chosen)


def kernels_of(model: FilterModel, *, is_linear: bool) -> tuple[str, ...]:
    """Name the kernels that a filter calls."""
    wanted: dict[tuple[str, ...], bool] = {
        FILTER_OF_LINEAR_LAWS: is_linear,
        INVERSE_DYNAMICS: is_linear,
        FILTER_BY_SENSITIVITIES: not is_linear,
        FILTERED_WRENCHES: bool(model.links),
        SENSORS: True,
        INDEPENDENT_COORDINATES: model.independent is not None,
        SLOPES_OF_CLOSURE: model.independent is not None,
        FILTERED_SENSORS: bool(model.parameters),
        FILTERED_ACCELERATIONS: model.measurement.depends_on_acceleration,
        FILTERED_ACCELERATIONS_BY_PARAMETERS: model.measurement.depends_on_acceleration and bool(model.parameters),
    }
    return kernel_group(model.model, *(group for group, is_wanted in wanted.items() if is_wanted))


def _vector(label: str, values: ArrayLike, size: int) -> Numbers:
    """Return finite numbers, (size,)."""
    allowed = f"({size},), finite numbers"
    array = numbers_in(label, values, allowed)
    if array.shape != (size,):
        raise InputError(f"{label}: got the shape {array.shape}; allowed: {allowed}")
    return array


@contextmanager
def _computing(label: str, given: Numbers) -> Iterator[None]:
    """Compute without warnings of numbers that overflow, which are looked at behind it.

    Raises:
        IntegrationError: equations cannot be solved with them.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except np.linalg.LinAlgError:
        raise _not_finite(label, given) from None


def _check_finite(label: str, given: Numbers, state: ArrayLike, uncertain: Covariance | SquareRoot) -> None:
    """Refuse what is not finite, of an estimate and its covariance."""
    with np.errstate(all="ignore"):
        if not np.isfinite(state).all() or not uncertain.is_finite:
            raise _not_finite(label, given)


def _not_finite(label: str, given: Numbers) -> IntegrationError:
    return IntegrationError(
        f"observer: {label} = {show(given.tolist())} is not allowed, as the estimate or its covariance would not be"
        " finite; allowed: smaller numbers, or begin anew"
    )


def _rows(q: ArrayLike, v: ArrayLike | None, n: int) -> tuple[Numbers, Numbers]:
    """Return states, (poses, n) each."""
    allowed = f"({n},) or (poses, {n}), finite numbers"
    rows = [numbers_in(label, x, allowed) for label, x in (("q", q), ("v", np.zeros(n) if v is None else v))]
    for label, array in zip("qv", rows, strict=True):
        if array.ndim not in (1, 2) or array.shape[-1] != n:
            raise InputError(f"{label}: got the shape {array.shape}; allowed: {allowed}")
    lead = joint_lead("v", rows[0].shape[:-1], rows[1].shape[:-1]) or (1,)
    return np.broadcast_to(rows[0], (*lead, n)), np.broadcast_to(rows[1], (*lead, n))
