"""The programs and weights that the paper's figures compare.

R is R-CBF-QP and H is H-CBF-QP. Both satisfy the rows of priority 1, among them that of region 1,
and relax the row of region 2, which has priority 2. Their weights are (γ₀, Δγ).
"""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, TypeVar

from hcbf_gym.evaluation.rollouts import Case

ROM, A1 = "HCBF-Regions-v0", "HCBF-A1Regions-v0"
"""The environments of the reduced-order model, a double integrator, and of the A1."""
H3, H4 = 2, 3  # columns of the barriers h₃ (region 1) and h₄ (region 2)
LIGHT_BOX = 0  # index of the box at the center of region 2, among the experiment's obstacles

Role = Literal["relaxed", "hierarchical", "too large"]
"""The role in a comparison: R, H, or H with weights that take the robot off its reference."""
T = TypeVar("T")


class Setting(NamedTuple):
    """A program with its weights."""

    role: Role
    program: str
    gamma0: float  # γ₀ [-]
    delta_gamma: float  # Δγ [1/m]

    def case(self, env: str, scene: Any, env_options: Any = None, **filter_options: Any) -> Case:
        """Return the case of an environment's robot that tracks a scene's reference by PD."""
        options = {"gamma0": self.gamma0, "delta_gamma": self.delta_gamma} | filter_options
        return Case(env, scene, "pd", self.program, options, env_options)


def of_role(by_setting: Mapping[Setting, T], role: Role) -> dict[Setting, T]:
    """Return the entries of the settings with a role, in their order."""
    return {setting: entry for setting, entry in by_setting.items() if setting.role == role}
