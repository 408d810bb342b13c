"""Methods on tiles beside the same methods on rows of states: equal to the bit, and in what they refuse."""

from __future__ import annotations

import gc
import inspect
import pickle
import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.contexts import TILE_BYTES as BYTES_IN_C
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import ArrayError, InputError, SingularError, UnknownNameError
from eomgen.runtime import Kernel
from eomgen.runtime.raw import TILE_BYTES
from eomgen.runtime.tiled import Tiled
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

Array = np.ndarray[Any, Any]
N = 21  # states, no multiple of a tile
RAIL = f"""
name = "rail"
{link_table("body", 1.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("slide", "base", "body", "prismatic")}
z.friction = {{ model = "lugre", coulomb = 1.0, bristle_stiffness = 1e3 }}
"""  # with a state
CLOSED = ("v", "a", "dv", "da")  # zeros of these keep loops closed


def made(name: str, dtype: str, built: Build) -> Kernel:
    return built(robot_from_toml(RAIL) if name == "rail" else load_robot(name), "all", dtype=dtype)


def arguments(kernel: Kernel, name: str, states: int = N) -> dict[str, Any]:
    """Return arguments of a method for so many states in rows."""
    rng = np.random.default_rng(len(name))
    given: dict[str, Any] = {}
    for label, parameter in list(inspect.signature(getattr(type(kernel), name)).parameters.items())[1:]:
        if label == "frame":
            given[label] = kernel.frames[-1]
        elif parameter.default is parameter.empty:
            shape = kernel.raw.shapes[label]
            x = rng.uniform(-0.3, 0.3, (states, *shape)).astype(kernel.dtype)
            if kernel.constraints and label == "q":
                x = np.tile(np.asarray(kernel.home, kernel.dtype), (states, 1))
            given[label] = np.zeros_like(x) if kernel.constraints and label in CLOSED else x
    return given


def packed(kernel: Kernel, given: dict[str, Any]) -> dict[str, Any]:
    return {label: kernel.tiled.pack(x) if isinstance(x, np.ndarray) else x for label, x in given.items()}


def answer(call: Any, given: dict[str, Any]) -> Any:
    """Return a result, or the text of what is raised."""
    try:
        return call(**given)
    except InputError as error:
        return f"{type(error).__name__}: {error}"


def rows(kernel: Kernel, found: Any) -> Any:
    """Return bytes of a result in tiles as if it were in rows; texts as they are."""
    if isinstance(found, tuple):
        return [kernel.tiled.unpack(x, N).tobytes() for x in found]
    return found if isinstance(found, str) else kernel.tiled.unpack(found, N).tobytes()


def plain(found: Any) -> Any:
    if isinstance(found, tuple):
        return [x.tobytes() for x in found]
    return found if isinstance(found, str) else found.tobytes()


@pytest.mark.parametrize(
    ("robot", "dtype"),
    [
        ("one_link", "float64"),
        pytest.param("one_link", "float32", marks=pytest.mark.soak),
        ("rail", "float64"),
        pytest.param("four_bar", "float64", marks=pytest.mark.soak),
        pytest.param("ur5", "float64", marks=pytest.mark.soak),
        pytest.param("ur5", "float32", marks=pytest.mark.soak),
        pytest.param("worn_arm", "float64", marks=pytest.mark.soak),
    ],
)
def test_tiles_have_the_bits_of_rows(robot: str, dtype: str, built: Build) -> None:
    """All methods, whether Python calls the C, the extension module does, or the function works state by state."""
    kernel = made(robot, dtype, built)
    names = [name for name in dir(kernel.tiled) if name in kernel.raw.functions]
    assert {"inverse_dynamics", "forward_dynamics", "mass_matrix", "frame_pose", "energy"} <= set(names)
    assert kernel.tiled.width == 64 // kernel.dtype.itemsize
    for name in names:
        given = arguments(kernel, name)
        expected = plain(answer(getattr(kernel, name), given))
        in_tiles = packed(kernel, given)
        method = getattr(kernel.tiled, name)
        in_python = getattr(Tiled(kernel, {name: getattr(type(kernel), name)}), name)
        for call in (method, in_python, method):
            assert rows(kernel, answer(call, in_tiles)) == expected, name
        if kernel.is_direct and not isinstance(expected, str) and kernel.raw.functions[name].takes_tiles:
            assert method.takes_many == (name != "constraint_forces" or not kernel.couplings), name


def test_one_tile_reaches_the_code_without_python(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = made("one_link", "float64", built)
    if not kernel.is_direct:
        pytest.skip("there is no extension module")
    given = packed(kernel, arguments(kernel, "inverse_dynamics"))
    expected = kernel.tiled.inverse_dynamics(**given)
    monkeypatch.setattr(type(kernel.tiled), "_call", None)
    assert np.array_equal(kernel.tiled.inverse_dynamics(**given), expected)
    out = np.empty_like(expected)
    assert kernel.tiled.inverse_dynamics(**given, out=out) is out
    assert np.array_equal(out, expected)
    one = kernel.tiled.unpack(given["q"])[0]
    alone = kernel.tiled.inverse_dynamics(one, given["v"], given["a"])  # one state stands for all
    assert np.array_equal(kernel.tiled.unpack(alone)[0], kernel.tiled.unpack(expected)[0])


def test_numbers_of_a_tile_stand_side_by_side(built: Build) -> None:
    kernel = made("one_link", "float64", built)
    assert TILE_BYTES == BYTES_IN_C == 64
    for shape in ((N, 2), (N, 2, 3), (16, 2), (1, 2), (0, 2)):
        x = np.random.default_rng(1).standard_normal(shape)
        tiles = kernel.tiled.pack(x)
        assert tiles.shape == (-(-shape[0] // 8), *shape[1:], 8)
        assert not tiles.size or tiles.ctypes.data % 64 == 0
        for k in range(shape[0]):
            assert np.array_equal(tiles[k // 8, ..., k % 8], x[k])
        assert all(np.array_equal(tiles[k // 8, ..., k % 8], x[-1]) for k in range(shape[0], 8 * len(tiles)))
        assert np.array_equal(kernel.tiled.unpack(tiles, shape[0]), x)
        assert len(kernel.tiled.unpack(tiles)) == 8 * len(tiles)


def test_what_is_converted_on_the_way(built: Build) -> None:
    """Wrenches, as arrays and by name, states of laws apart, open loops, and arrays that are not plain."""
    kernel = made("one_link", "float64", built)
    rng, given = np.random.default_rng(2), arguments(kernel, "forward_dynamics")
    wrench = rng.standard_normal((N, len(kernel.links), 6))
    by_name = {kernel.links[0]: wrench[:, 0]}
    for name in ("forward_dynamics", "inverse_dynamics", "generalized_force"):
        given = arguments(kernel, name)
        for loaded in (wrench, by_name, wrench[0]):
            expected = getattr(kernel, name)(**given, wrench=loaded)
            if isinstance(loaded, dict):
                tiled: Any = {key: kernel.tiled.pack(x) for key, x in loaded.items()}
            else:
                tiled = kernel.tiled.pack(loaded) if loaded.ndim > 2 else loaded
            found = getattr(kernel.tiled, name)(**packed(kernel, given), wrench=tiled)
            assert kernel.tiled.unpack(found, N).tobytes() == expected.tobytes(), name
    in_tiles = packed(kernel, given := arguments(kernel, "mass_matrix"))
    expected = kernel.tiled.mass_matrix(**in_tiles)
    out = np.empty_like(expected)
    assert kernel.tiled.mass_matrix(in_tiles["q"].tolist(), out=out) is out
    assert np.array_equal(out, expected)
    assert np.array_equal(kernel.tiled.mass_matrix(given["q"][0]), kernel.mass_matrix(given["q"][0]))
    rail = made("rail", "float64", built)
    q, v, u, z = (rng.standard_normal((N, 1)) for _ in range(4))
    found = rail.tiled.forward_dynamics(*map(rail.tiled.pack, (q, v, u, z)))
    assert rail.tiled.unpack(found, N).tobytes() == rail.forward_dynamics(q, v, u, z).tobytes()
    jacobian = arguments(kernel, "residual_jacobian")
    whole = np.empty((3, 3, kernel.n, kernel.n, 8))
    parts = kernel.tiled.residual_jacobian(**packed(kernel, jacobian), out=whole)
    assert all(np.shares_memory(part, whole) for part in parts)
    with_u = kernel.tiled.residual_jacobian(**packed(kernel, jacobian), u=kernel.tiled.pack(jacobian["q"]))
    for part, other, row in zip(parts, with_u, kernel.residual_jacobian(**jacobian), strict=True):
        assert np.array_equal(kernel.tiled.unpack(part, N), row)
        assert np.array_equal(part, other)


def test_wrenches_on_tiles_reach_the_code_without_a_conversion(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = made("one_link", "float64", built)
    wrench = np.random.default_rng(5).standard_normal((N, len(kernel.links), 6))
    for name in ("forward_dynamics", "inverse_dynamics", "residual", "reactions"):
        given = arguments(kernel, name)
        expected = getattr(kernel, name)(**given, wrench=wrench)
        with monkeypatch.context() as patched:
            patched.setattr(Tiled, "_converted", None)
            tiles = packed(kernel, given)
            found = getattr(kernel.tiled, name)(**tiles, wrench=kernel.tiled.pack(wrench))
            out = np.empty_like(found)
            assert getattr(kernel.tiled, name)(**tiles, wrench=kernel.tiled.pack(wrench), out=out) is out
        assert kernel.tiled.unpack(found, N).tobytes() == expected.tobytes(), name
        assert np.array_equal(out, found)


@pytest.mark.soak
def test_derivatives_on_tiles_have_the_bits_of_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of arguments without more through the C; of frames and by parameters by way of rows."""
    kernel = eomgen.build("one_link")
    tiled, rng = kernel.tiled, np.random.default_rng(3)
    q, v, a, dq, dv, da, w = rng.uniform(-0.3, 0.3, (7, N, kernel.n))
    tiles = [tiled.pack(x) for x in (q, v, a, dq, dv, da, w)]
    name, parameter = "inverse_dynamics", next(iter(kernel.parameters))
    expected = [
        (kernel.jvp(name, (q, v, a), (dq, dv, da)),),
        kernel.vjp(name, (q, v, a), w),
        (kernel.hessian(name, (q, v, a), w),),
    ]
    with monkeypatch.context() as patched:
        patched.setattr(Tiled, "_argument_rows", None)
        found = [
            (tiled.jvp(name, tiles[:3], tiles[3:6]),),
            tiled.vjp(name, tiles[:3], tiles[6]),
            (tiled.hessian(name, tiles[:3], tiles[6]),),
        ]
    expected.append((kernel.jvp(name, (q, v, a), (dq, dv, da), parameters={parameter: 0.5}),))
    found.append((tiled.jvp(name, tiles[:3], tiles[3:6], parameters={parameter: 0.5}),))
    expected.append(kernel.vjp(name, (q, v, a), w, (parameter,)))
    found.append(tiled.vjp(name, tiles[:3], tiles[6], (parameter,)))
    frame, weights = kernel.frames[-1], rng.standard_normal((N, 4, 4))
    expected.append((kernel.jvp("frame_pose", (q, frame), (dq,)),))
    found.append((tiled.jvp("frame_pose", (tiles[0], frame), (tiles[3],)),))
    expected.append(kernel.vjp("frame_pose", (q, frame), weights))
    found.append(tiled.vjp("frame_pose", (tiles[0], frame), tiled.pack(weights)))
    for some, others in zip(found, expected, strict=True):
        assert [tiled.unpack(x, N).tobytes() for x in some] == [x.tobytes() for x in others]
    assert np.array_equal(tiled.jvp(name, (q[0], v[0], a[0]), (dq[0], dv[0], da[0])), expected[0][0][0])
    refused(ArrayError, r"^dv: 2 tiles, but 3 in q$", tiled.jvp, name, tiles[:3], (tiles[3], tiles[4][:2], tiles[5]))
    refused(UnknownNameError, "no_such", tiled.vjp, "no_such", tiles[:3], tiles[6])
    refused(InputError, "tangents", tiled.jvp, name, tiles[:3], tiles[3:5])


def test_rollouts_on_tiles_have_the_bits_of_rows(built: Build) -> None:
    kernel = made("one_link", "float64", built)
    tiled, rng = kernel.tiled, np.random.default_rng(4)
    q, v, u = rng.uniform(-0.01, 0.01, (3, N, kernel.n))
    over_time = rng.uniform(-0.01, 0.01, (N, 6, kernel.n))
    fixed, adaptive = {"dt": 1e-5, "steps": 6, "every": 2}, {"duration": 1e-4, "samples": 3, "rtol": 1e-4}
    for given, options in ((u, fixed), (over_time, fixed), (u[0], fixed), (u, adaptive)):
        expected = kernel.rollout(q, v, given, **options)
        found = tiled.rollout(tiled.pack(q), tiled.pack(v), tiled.pack(given) if given.ndim > 1 else given, **options)
        for some, other in zip(found, expected, strict=True):
            assert some.shape == (3, *other.shape[1:], 8)
            assert tiled.unpack(some, N).tobytes() == other.tobytes()
        for figure in ("steps", "rejected", "largest", "smallest"):
            assert np.array_equal(getattr(found, figure).ravel()[:N], getattr(expected, figure)), figure
    alone = tiled.rollout(q[0], v[0], **fixed)
    assert np.array_equal(alone[0], kernel.rollout(q[0], v[0], **fixed)[0])
    for given, said in ((q, r"^q0: got shape \(21, 2\); allowed: \(n,\), or in tiles \(T, n, 8\)$"),):
        refused(ArrayError, said, tiled.rollout, given, tiled.pack(v), **fixed)
    with pytest.raises(ArrayError, match=r"^u: got shape \(6, 2\); .*, or \(T, steps, n, 8\)$"):
        tiled.rollout(tiled.pack(q), tiled.pack(v), over_time[0], **fixed)
    refused(ArrayError, r"^v0: 2 tiles, but 3 in q0$", tiled.rollout, tiled.pack(q), tiled.pack(v)[:2], **fixed)


def test_conversions_are_those_of_numpy(built: Build) -> None:
    kernel = made("one_link", "float64", built)
    plain = Tiled(kernel, {})
    x = np.random.default_rng(6).standard_normal((N, 3, 5))
    assert np.array_equal(kernel.tiled.pack(x), plain.pack(x))
    assert np.array_equal(kernel.tiled.unpack(plain.pack(x), N), x)
    assert np.array_equal(plain.unpack(plain.pack(x), N), x)
    assert np.array_equal(kernel.tiled.pack(x[:, ::2]), plain.pack(x[:, ::2]))


def test_threads_share_tiles(built: Build) -> None:
    kernel = made("one_link", "float64", built)
    given = arguments(kernel, "inverse_dynamics", 1001)
    shared = kernel.with_threads(2)
    found = shared.tiled.inverse_dynamics(**packed(kernel, given))
    assert np.array_equal(kernel.tiled.unpack(found, 1001), kernel.inverse_dynamics(**given))


def test_parameters_and_checks_are_those_of_the_kernel(built: Build) -> None:
    kernel = made("one_link", "float64", built).with_parameters()
    given = packed(kernel, arguments(kernel, "inverse_dynamics"))
    before = kernel.tiled.inverse_dynamics(**given)
    name = next(x for x in kernel.parameters if x.endswith("stiffness"))
    other = kernel.with_parameters({name: 2.0 * kernel.parameters[name]})
    assert not np.array_equal(other.tiled.inverse_dynamics(**given), before)
    assert np.array_equal(kernel.tiled.inverse_dynamics(**given), before)
    kernel.parameters[name] *= 2.0
    assert np.array_equal(kernel.tiled.inverse_dynamics(**given), other.tiled.inverse_dynamics(**given))
    assert np.array_equal(
        pickle.loads(pickle.dumps(kernel.tiled)).inverse_dynamics(**given), other.tiled.inverse_dynamics(**given)
    )
    given["q"][1, 0, 3] = np.nan
    with pytest.raises(ArrayError, match=r"^q: joint1\.\w+ in state 11 is nan; numbers must be finite$"):
        kernel.tiled.inverse_dynamics(**given)
    unchecked = kernel.with_checks(False).tiled.inverse_dynamics(**given)
    assert np.isnan(unchecked[1, :, 3]).any()
    assert np.isfinite(np.delete(kernel.tiled.unpack(unchecked), 11, 0)).all()


def test_kernels_with_tiles_go_with_their_last_reference(built: Build) -> None:
    kernel = made("one_link", "float64", built).with_parameters()
    assert kernel.tiled is kernel.tiled
    gc.collect()
    gc.disable()
    try:
        gone = weakref.ref(kernel)
        del kernel
        assert gone() is None
    finally:
        gc.enable()


def test_a_singular_state_is_named_by_its_number(built: Build) -> None:
    """Wherever it stands in a tile."""
    robot = load_robot("one_link")
    link = replace(robot.links[-1], mass=0.0, inertia=(0.0,) * 6)
    massless = built(replace(robot, links=(*robot.links[:-1], link)), "forward_dynamics", "mass_matrix")
    x = np.zeros((N, massless.n))
    expected = refused(SingularError, "", massless.forward_dynamics, x, x, x)
    for _ in range(2):  # by Python, which arms nothing, and again
        found = refused(SingularError, "", massless.tiled.forward_dynamics, *(massless.tiled.pack(x) for _ in "qvu"))
        assert str(found) == str(expected)
    assert "in state 0" in str(found)


def test_what_is_refused(built: Build) -> None:
    kernel = made("one_link", "float64", built)
    tiled, x = kernel.tiled, np.zeros((3, 2, 8))
    shapes = r"allowed: \(2,\), or in tiles \(T, 2, 8\)$"
    for call, error, said in (
        (lambda: tiled.mass_matrix(np.zeros((24, 2))), ArrayError, rf"^q: got shape \(24, 2\); {shapes}"),
        (lambda: tiled.mass_matrix(np.zeros((3, 2, 4))), ArrayError, shapes),
        (lambda: tiled.mass_matrix(np.zeros((3, 3, 8))), ArrayError, r"^q: expected float64 of shape \(2,\)"),
        (lambda: tiled.bias_force(x, x[:2]), ArrayError, r"^v: 2 tiles, but 3 in q$"),
        (
            lambda: tiled.bias_force(x, x, out=np.zeros((3, 2))),
            ArrayError,
            r"^out: expected float64 of shape \(3, 2, 8",
        ),
        (lambda: tiled.bias_force(x, x, out=x), ArrayError, "^out: overlaps an argument"),
        (lambda: tiled.frame_pose(x, "no_such"), UnknownNameError, "no_such"),
        (lambda: tiled.pack(np.zeros(3)), ArrayError, r"^x: expected float64 of shape \(N, n\)"),
        (lambda: tiled.pack([["a"]]), ArrayError, "^x: expected"),
        (lambda: tiled.unpack(np.zeros((3, 2))), ArrayError, r"\(T, n, 8\)"),
        (
            lambda: tiled.unpack(x, 16),
            InputError,
            "^N: 16; allowed: a whole number from 17 to 24, as there are 3 tiles",
        ),
        (lambda: tiled.unpack(x, True), InputError, "^N: true; allowed"),
        (
            lambda: tiled.rollout_gradient,
            AttributeError,
            "^tiled: 'rollout_gradient' is no method on tiles; allowed: .*mass_matrix",
        ),
    ):
        refused(error, said, call)
    refused(TypeError, "", tiled.bias_force, x)
