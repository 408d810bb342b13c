"""Functions of PyTorch on the processor against the kernels they are made of, and by PyTorch's own checks."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.adapters.mappings import kernels_for
from eomgen.adapters.torch import Operators, function
from eomgen.errors import ArrayError, InputError, UnknownNameError
from tests.support.adapter_samples import BENDING, built_for, functions_of, sample, states
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.optional import needs
from tests.support.random_robots import Array, seeds
from tests.support.refusals import refused

torch = needs("torch", extra="torch")
COUNT = 3


def tensors(*arrays: Array, grad: bool = True) -> list[Any]:
    """Tensors that ask for gradients."""
    return [torch.from_numpy(np.array(x)).requires_grad_(grad) for x in arrays]


def operators_of(made: Any) -> Operators:
    """The operators that a function calls."""
    (found,) = (cell.cell_contents for cell in made.__closure__ if isinstance(cell.cell_contents, Operators))
    return found


@pytest.fixture(scope="module")
def one_link(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("one_link"), *kernels_for("forward_dynamics"))


@pytest.mark.parametrize("seed", [4100, *seeds(4101, 0, 30), pytest.param(BENDING, marks=pytest.mark.soak)])
def test_values_and_gradients_are_the_kernels(seed: int, built: Build, figures: Figures) -> None:
    """Of all functions, for one state and for many; second ones against those of the kernel's gradient."""
    robot = sample(seed)
    kernel = built_for(robot, built)
    given = states(robot, kernel, seed)
    rng = np.random.default_rng(seed)
    for there in functions_of(robot, kernel):
        made = function(kernel, there.name, there.frame, cut=True)
        one = [given[name] for name in there.reads]
        many = [x + 1e-3 * rng.uniform(-1.0, 1.0, (COUNT, *x.shape)) for x in one]
        for arrays, lead in ((one, ()), (many, (COUNT,))):
            pull, given_to = rng.uniform(-1.0, 1.0, (*lead, *there.output)), tensors(*arrays)
            value = made(*given_to)
            figures.at_most("value", float(np.abs(value.detach().numpy() - there.value(*arrays)).max()), 1e-13)
            (value * torch.from_numpy(pull)).sum().backward()
            for x, expected in zip(given_to, there.gradient(arrays, pull), strict=True):
                size = max(float(np.abs(expected).max()), 1.0)
                figures.at_most("gradient", float(np.abs(x.grad.numpy() - expected).max()) / size, 1e-12)
        figures.count("functions")


def test_pytorchs_own_checks_hold(one_link: eomgen.Kernel) -> None:
    """Differences of first and second derivatives, and what compilers ask of an operator."""
    made, rng = function(one_link, "forward_dynamics"), np.random.default_rng(0)
    q, v, u = tensors(*rng.uniform(-1e-3, 1e-3, (3, 2, one_link.n)))
    assert torch.autograd.gradcheck(made, (q, v, u), eps=1e-7, atol=1e-4)
    assert torch.autograd.gradgradcheck(made, (q, v, u), eps=1e-7, atol=1e-2)
    found = torch.library.opcheck(operators_of(made).compiled, (q, v, u))
    assert set(found.values()) == {"SUCCESS"}
    second = torch.autograd.grad(made(q, v, u).sum(), q, create_graph=True)[0]
    with pytest.raises(RuntimeError, match=r"no autograd formula was registered|does not require grad"):
        torch.autograd.grad(torch.autograd.grad(second.square().sum(), q, create_graph=True)[0].sum(), q)


def test_transforms_of_pytorch(one_link: eomgen.Kernel) -> None:
    """torch.func and vmap by the kernel's Jacobian; leading axes as of broadcasting."""
    made, rng = function(one_link, "forward_dynamics"), np.random.default_rng(1)
    arrays = list(rng.uniform(-1e-3, 1e-3, (3, 5, one_link.n)))
    q, v, u = tensors(*arrays, grad=False)
    blocks = torch.func.vmap(torch.func.jacrev(made, (0, 1, 2)))(q, v, u)
    expected = one_link.forward_dynamics_jacobian(*arrays)
    for block, wanted in zip(blocks, expected, strict=True):
        assert np.allclose(block.numpy(), wanted, rtol=1e-12, atol=1e-12)
    beside = torch.func.vmap(made, (0, None, 0))(q, v[0], u)
    assert np.array_equal(beside, one_link.forward_dynamics(arrays[0], arrays[1][0], arrays[2]))
    across = torch.func.vmap(operators_of(made).compiled, (1, None, 0))(torch.stack([q, u], 1), v, torch.stack([u, q]))
    assert np.array_equal(across[1], one_link.forward_dynamics(arrays[2], arrays[1], arrays[0]))
    wide = made(q[:, None], v, u[0])
    assert wide.shape == (5, 5, one_link.n)
    assert np.array_equal(wide[3], one_link.forward_dynamics(np.tile(arrays[0][3], (5, 1)), arrays[1], arrays[2][0]))
    assert made(q[:0], v[:0], u[:0]).shape == (0, one_link.n)
    second = torch.func.jacrev(torch.func.jacrev(lambda x: made(x, v[0], u[0]).sum()))(q[0])
    by_q = one_link.hessian("forward_dynamics", tuple(x[0] for x in arrays), np.ones(one_link.n))[:2, :2]
    assert np.allclose(second, by_q, rtol=1e-12)


@pytest.mark.soak
def test_compiled_graphs_hold_the_operator(one_link: eomgen.Kernel) -> None:
    made, rng = function(one_link, "forward_dynamics"), np.random.default_rng(2)
    arrays = rng.uniform(-1e-3, 1e-3, (3, 4, one_link.n))
    both = [tensors(*arrays), tensors(*arrays)]
    compiled = torch.compile(lambda *x: made(*x).square().sum(), fullgraph=True, backend="aot_eager")
    values = [call(*x) for call, x in zip((compiled, lambda *x: made(*x).square().sum()), both, strict=True)]
    for value in values:
        value.backward()
    assert torch.equal(*values)
    for one, other in zip(*both, strict=True):
        assert torch.equal(one.grad, other.grad)


def test_in_single_precision(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("inverse_dynamics"), dtype="float32")
    made = function(kernel, "inverse_dynamics")
    arrays = np.random.default_rng(3).uniform(-1e-3, 1e-3, (3, 4, kernel.n)).astype(np.float32)
    q, v, a = tensors(*arrays)
    value = made(q, v, a)
    assert np.array_equal(value.detach(), kernel.inverse_dynamics(*arrays))
    value.sum().backward()
    assert q.grad.dtype == torch.float32
    assert np.allclose(q.grad, kernel.vjp("inverse_dynamics", tuple(arrays), np.ones_like(arrays[0]))[0], rtol=1e-6)
    refused(ArrayError, r"q: dtype torch\.float64; allowed: torch\.float32", made, q.double(), v, a)


def test_what_is_refused(one_link: eomgen.Kernel, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    made = function(one_link, "forward_dynamics")
    q = torch.zeros(4, one_link.n, dtype=torch.float64)
    for arrays, said in (
        ((q.numpy(), q, q), r"q: got numpy\.ndarray; allowed: a tensor of PyTorch"),
        ((q, q[:, :1], q), r"v: shape \(4, 1\); allowed: \(2,\) or \(\.\.\., 2\)"),
        ((q, q[:3], q), r"v: leading axes \(3,\) beside \(4,\); allowed: those of broadcasting"),
        ((q, q, q * np.nan), "u: .* is nan"),
    ):
        refused(ArrayError, said, made, *arrays)
    assert made(*[q.to("meta")] * 3).shape == q.shape
    with pytest.raises(
        ArrayError, match="q: a tensor on meta; allowed: on the processor, or a function of a kernel's d"
    ):
        operators_of(made)._run("value", [q.to("meta"), q, q])
    refused(InputError, "forward_dynamics: got 2 tensors; allowed: q, v, u", made, q, q)
    refused(UnknownNameError, r"'forward_dynamic'", function, one_link, "forward_dynamic")
    first = function(built(eomgen.load_robot("one_link"), *kernels_for("energy", order=1)), "energy")
    refused(UnknownNameError, "built without", first(q.clone().requires_grad_(), q).sum().backward)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r'functions of PyTorch need torch.*pip install "eomgen\[torch\]"'):
        function(one_link, "forward_dynamics")
