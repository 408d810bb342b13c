"""Functions of PyTorch on devices: tensors of the processor stand for those of the stub's device."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.adapters.torch import function
from eomgen.errors import ArrayError, InputError, UnknownNameError
from tests.device.fakes import COUNT, Stub, states
from tests.support.optional import needs
from tests.support.refusals import refused

torch = needs("torch", extra="torch")
STREAM = 11


def interface(x: Any) -> dict[str, Any]:
    """Say of a tensor what PyTorch says of those on devices."""
    if x.requires_grad:
        raise RuntimeError("Can't get __cuda_array_interface__ on Variable that requires grad.")
    size = x.element_size()
    strides = None if x.is_contiguous() else tuple(size * step for step in x.stride())
    data = (x.data_ptr() if x.numel() else 0, False)
    return {"typestr": f"<f{size}", "shape": tuple(x.shape), "strides": strides, "data": data, "version": 2}


@pytest.fixture
def lying(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tensors lie on the stub's device, and PyTorch works on a stream of its own."""
    monkeypatch.setattr(torch.Tensor, "__cuda_array_interface__", property(interface))
    monkeypatch.setattr(torch.cuda, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda number: SimpleNamespace(cuda_stream=STREAM + number))


def tensors(kernel: eomgen.Kernel, number: int, count: int = COUNT, scale: float = 1e-2) -> list[Any]:
    """Random tensors of states that ask for gradients."""
    return [torch.from_numpy(x).requires_grad_() for x in states(kernel, number, count, scale)]


@pytest.mark.usefixtures("lying")
def test_values_and_gradients_have_the_bits_of_the_kernel(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    made = function(device, "inverse_dynamics")
    q, v, a = tensors(kernel, 3)
    arrays = [x.detach().numpy() for x in (q, v, a)]
    launches = stub.count("launches")
    value = made(q, v, a)
    assert np.array_equal(value.detach(), kernel.inverse_dynamics(*arrays))
    assert stub.count("launches") > launches
    weights = torch.linspace(-1.0, 1.0, value.numel(), dtype=value.dtype).reshape(value.shape)
    (value * weights).sum().backward()
    expected = kernel.vjp("inverse_dynamics", tuple(arrays), weights.numpy())
    for x, wanted in zip((q, v, a), expected, strict=True):
        assert np.array_equal(x.grad, wanted)
    assert np.array_equal(made(q.T.contiguous().T, v, a).detach(), value.detach())
    assert made(q[:0], v[:0], a[:0]).shape == (0, kernel.n)
    assert np.array_equal(made(q[3], v[3], a[3]).detach(), value[3].detach())
    assert stub.count("contexts") == 0


@pytest.mark.usefixtures("lying")
def test_differences_agree(kernel: eomgen.Kernel, device: Any) -> None:
    """First and second derivatives on the device, by PyTorch's differences."""
    made, (q,) = function(device, "mass_matrix"), tensors(kernel, 1, 3)
    assert torch.autograd.gradcheck(made, (q,), eps=1e-6, atol=1e-7)
    assert torch.autograd.gradgradcheck(made, (q,), eps=1e-6, atol=1e-6)
    assert set(torch.library.opcheck(operators(made), (q,)).values()) == {"SUCCESS"}
    rows = torch.func.vmap(torch.func.jacrev(made))(q.detach())
    assert np.allclose(rows, torch.func.jacrev(lambda x: made(x).sum(0))(q.detach()).movedim(2, 0), atol=1e-14)


def operators(made: Any) -> Any:
    """The operator of a function's value."""
    return next(x.cell_contents for x in made.__closure__ if hasattr(x.cell_contents, "compiled")).compiled


@pytest.mark.usefixtures("lying")
def test_work_goes_to_the_stream_of_pytorch(
    kernel: eomgen.Kernel, device: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    streams, launch = [], type(device.cuda).launch

    def watched(self: Any, functions: Any, name: str, threads: int, arguments: Any, stream: int) -> None:
        streams.append(stream)
        launch(self, functions, name, threads, arguments, stream)

    monkeypatch.setattr(type(device.cuda), "launch", watched)
    (q,) = tensors(kernel, 1)
    function(device, "mass_matrix")(q).sum().backward()
    assert set(streams) == {STREAM}


@pytest.mark.usefixtures("lying")
def test_frames_are_all_of_the_robot(kernel: eomgen.Kernel, device: Any) -> None:
    made, (q,) = function(device, "frame_poses"), tensors(kernel, 1, 2)
    poses, frame = made(q), kernel.frames[-1]
    assert np.allclose(poses[:, -1].detach(), kernel.frame_pose(q.detach().numpy(), frame)[:, :3], atol=1e-15)
    poses[:, -1].sum().backward()
    weights = np.ones((2, 4, 4))
    assert np.allclose(q.grad, kernel.vjp("frame_pose", (q.detach().numpy(), frame), weights)[0], atol=1e-14)


@pytest.mark.soak
@pytest.mark.usefixtures("lying")
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("robot", ["ur5", "worn_arm"])
def test_arms_have_the_gradients_of_their_kernels(robot: str, dtype: str, built: Any, stub: Stub) -> None:
    kernel = built(robot, "forward_dynamics", "forward_dynamics_adjoint", dtype=dtype)
    made, (q, v, u) = function(kernel.device("cuda"), "forward_dynamics"), tensors(kernel, 3, scale=0.5)
    value = made(q, v, u)
    value.backward(torch.ones_like(value))
    arrays = tuple(x.detach().numpy() for x in (q, v, u))
    assert np.array_equal(value.detach(), kernel.forward_dynamics(*arrays))
    for x, wanted in zip((q, v, u), kernel.vjp("forward_dynamics", arrays, np.ones_like(arrays[0])), strict=True):
        assert np.array_equal(x.grad, wanted)


@pytest.mark.soak
@pytest.mark.usefixtures("lying")
def test_closed_mechanisms_have_values_alone(built: Any, stub: Stub) -> None:
    kernel = built("four_bar", "forward_dynamics", "settling", "cut_poses")
    q = torch.from_numpy(kernel.assemble(np.array([[0.5, 0.2, 1.2]]))).requires_grad_()
    value = function(kernel.device("cuda"), "forward_dynamics")(q, 0.0 * q, 0.0 * q)
    assert np.array_equal(
        value.detach(), kernel.forward_dynamics(q.detach().numpy(), np.zeros((1, 3)), np.zeros((1, 3)))
    )
    with pytest.raises(InputError, match="'forward_dynamics_adjoint' of a closed mechanism checks and assembles loops"):
        value.sum().backward()


def test_what_is_refused(kernel: eomgen.Kernel, device: Any) -> None:
    q = torch.zeros(3, kernel.n, dtype=torch.float64)
    with pytest.raises(ArrayError, match=r"q: torch\.Tensor lies on the processor; allowed: arrays on the device"):
        function(device, "mass_matrix")(q)
    refused(ArrayError, r"q: dtype torch\.float32; allowed: torch\.float64", function(device, "mass_matrix"), q.float())
    refused(InputError, "rk4_rollout: a rollout, which has no derivatives on devices", function, device, "rk4_rollout")
    with pytest.raises(InputError, match="frame: 'tcp'; allowed on devices: none, frame_poses and frame_jacobians"):
        function(device, "frame_poses", "tcp")
    refused(InputError, "cut: true; allowed on devices: none", function, device, "mass_matrix", cut=True)
    refused(UnknownNameError, "'mass_matrixx' is unknown", function, device, "mass_matrixx")


@pytest.mark.usefixtures("lying")
def test_states_that_fail_are_named_in_graphs(kernel: eomgen.Kernel, device: Any) -> None:
    q, v, a = tensors(kernel, 3, 3)
    with pytest.raises(ArrayError, match=r"^v: .* in state 1 is nan; numbers must be finite"):
        function(device, "inverse_dynamics")(q, v + torch.tensor([[0.0], [np.nan], [0.0]]), a)
