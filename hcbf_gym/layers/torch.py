"""The safety filter as a layer of PyTorch, the extra ``rl``."""

from collections.abc import Sequence
from typing import Any

from hcbf_gym.barriers.many import Element
from hcbf_gym.errors import MissingDependencyError, install, instance
from hcbf_gym.layers.flat import MARGIN_SIZE, Filtered, FlatFilter

try:
    import torch
    from torch.autograd.function import once_differentiable
except ImportError as error:
    raise MissingDependencyError(
        f"SafetyLayer: got no torch, expected the extra rl: {install('rl')}"
    ) from error


class SafetyLayer(torch.nn.Module):
    """u as a differentiable function of u*, the state, the barriers' numbers and their margins.

    The layer has the rows and the program of the filter, without guidance and without checks of the
    state. It has derivatives of the first order in reverse mode, on the CPU in 64 bit.

    Args:
        barriers: m barriers of built-in kinds.
        settings: the other arguments of `layers.flat.FlatFilter`: `input_set`, `program`, `alpha1`,
            `alpha2`, `alpha_speed`, `period`, and the program's options.

    Raises:
        InvalidInputError: on a barrier of another kind, or malformed settings.
        UnknownNameError: on an unknown program; the message lists the choices.

    Attributes:
        blocks: (m, 19) a buffer of the barriers' numbers, whose columns `barriers.layout` names.
    """

    blocks: torch.Tensor

    def __init__(self, barriers: Sequence[Element], **settings: Any) -> None:
        super().__init__()
        self._flat = FlatFilter(barriers, **settings)
        self.register_buffer("blocks", torch.from_numpy(self._flat.blocks.copy()))

    def forward(
        self,
        u_nominal: torch.Tensor,
        x: torch.Tensor,
        blocks: torch.Tensor | None = None,
        margin: torch.Tensor | None = None,
        t: torch.Tensor | float = 0.0,
    ) -> Filtered:
        """Filter nominal inputs. The leading axes of all arguments broadcast.

        Args:
            u_nominal: (…, 2) u* [m/s²].
            x: (…, 4) position [m] and velocity [m/s].
            blocks: (…, m, 19) the barriers' numbers; the buffer `blocks` unless given.
            margin: (…, m, 3) the margin m of each row with its derivatives ṁ and m̈; 0 unless given.
            t: (…,) the time, for barriers that move [s]; it has no derivative.

        Returns:
            u of the type and device of u*, the statuses, and where u has no derivative.

        Raises:
            InvalidInputError: on shapes that do not fit, or entries that are not finite.
        """
        blocks = self.blocks if blocks is None else blocks
        if margin is None:
            margin = self.blocks.new_zeros((len(self.blocks), MARGIN_SIZE))
        t = torch.as_tensor(t).detach()
        arguments = {"u_nominal": u_nominal, "x": x, "blocks": blocks, "margin": margin, "t": t}
        tensors = [
            instance(name, argument, torch.Tensor).to("cpu", torch.float64)
            for name, argument in arguments.items()
        ]
        variables, times = self._flat.variables(torch, *tensors)
        u, status, degenerate = _Filter.apply(variables, times, self._flat)
        device = u_nominal.device
        return Filtered(u.to(u_nominal), status.to(device), degenerate.to(device))


class _Filter(torch.autograd.Function):
    """The autograd function of the filter, of variables (…, K) and times (…,) on the CPU."""

    @staticmethod
    def forward(ctx: Any, variables: torch.Tensor, t: torch.Tensor, flat: FlatFilter) -> Any:
        ctx.save_for_backward(variables, t)
        ctx.flat = flat
        results = flat.filter(variables.detach().numpy(), t.numpy())
        u, status, degenerate = map(torch.from_numpy, results)
        ctx.mark_non_differentiable(status, degenerate)
        return u, status, degenerate

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *grads: Any) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        variables, t = ctx.saved_tensors
        w = grads[0]  # (…, 2) of u, the only result that has derivatives
        product = ctx.flat.pull_back(variables.detach().numpy(), t.numpy(), w.numpy())
        return torch.from_numpy(product), None, None  # t and flat have no derivatives
