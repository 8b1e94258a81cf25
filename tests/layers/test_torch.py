"""`SafetyLayer`: gradcheck, types, shapes."""

import importlib
import sys

import numpy as np
import pytest
from central_differences import BARRIERS, arrays
from needs import remedy

from hcbf_gym.errors import InvalidInputError, MissingDependencyError

torch = pytest.importorskip("torch", reason=remedy("torch"))
from hcbf_gym.layers.torch import SafetyLayer  # noqa: E402


def tensors(count=6):
    return [torch.tensor(one, requires_grad=True) for one in arrays(count)]


@pytest.mark.parametrize("settings", [{}, {"period": 0.05}, {"program": "r-cbf-qp"}], ids=str)
def test_gradcheck_in_all_that_u_is_a_function_of(settings):
    layer = SafetyLayer(BARRIERS, **settings)
    blocks = layer.blocks.clone().requires_grad_()
    margin = torch.full((3, 3), 0.01, dtype=torch.float64).requires_grad_()
    assert not layer(*tensors(), blocks, margin).degenerate.any()
    assert torch.autograd.gradcheck(lambda *given: layer(*given).u, (*tensors(), blocks, margin))


def test_leading_axes_broadcast_and_single_precision_comes_back():
    layer, (u_nominal, x) = SafetyLayer(BARRIERS), tensors()
    many = layer(u_nominal[:, None].float(), x[None], t=torch.zeros(6))
    assert many.u.shape == (6, 6, 2)
    assert many.u.dtype == torch.float32
    assert many.status.shape == many.degenerate.shape == (6, 6)
    one = layer(u_nominal[2].float(), x[3])
    np.testing.assert_array_equal(many.u[2, 3].detach(), one.u.detach())


def test_a_network_before_the_layer_learns_through_it():
    torch.manual_seed(0)
    layer, (_, x) = SafetyLayer(BARRIERS), tensors(64)
    policy = torch.nn.Linear(4, 2, dtype=torch.float64)
    descent, losses = torch.optim.SGD(policy.parameters(), 0.02), []
    for _ in range(20):
        loss = (layer(policy(x.detach()), x.detach()).u - 1.0).square().mean()
        descent.zero_grad()
        loss.backward()
        losses.append(loss.item())
        descent.step()
    assert (np.diff(losses) < 0.0).all()


@pytest.mark.parametrize(
    ("place", "shape", "expected"),
    [
        (0, (6, 3), r"u_nominal: got shape \(6, 3\), expected \(\.\.\., 2\)"),
        (1, (2,), r"x: got shape \(2,\), expected \(\.\.\., 4\)"),
        (2, (2, 19), r"blocks: .* expected \(\.\.\., 3, 19\)"),
        (3, (3,), r"margin: .* expected \(\.\.\., 3, 3\)"),
        (1, (5, 4), "expected leading axes that broadcast"),
        (4, (5,), "expected leading axes that broadcast"),
    ],
)
def test_wrong_shapes_are_refused(place, shape, expected):
    layer = SafetyLayer(BARRIERS)
    given = [*tensors(), layer.blocks, torch.zeros(3, 3), torch.zeros(6)]
    given[place] = torch.zeros(shape, dtype=torch.float64)
    with pytest.raises(InvalidInputError, match=expected):
        layer(*given)


def test_other_things_than_tensors_are_refused():
    with pytest.raises(InvalidInputError, match=r"x: got .* expected a Tensor"):
        SafetyLayer(BARRIERS)(tensors()[0], [0.0] * 4)


def test_a_missing_torch_is_named_with_its_install_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "hcbf_gym.layers.torch")
    with pytest.raises(MissingDependencyError, match=r"pip install .*\[rl\]"):
        importlib.import_module("hcbf_gym.layers.torch")
