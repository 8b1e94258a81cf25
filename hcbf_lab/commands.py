"""The commands of studies, which the entry points of `hcbf.commands` name."""

from hcbf_gym.arguments import Subcommand

COMMANDS = {
    "certify": Subcommand(
        "hcbf_lab.certification.command",
        "how often a plant enters rank 1 at most: margins measured, then a bound",
    ),
    "reproduce": Subcommand(
        "hcbf_lab.reproduction.command",
        "every figure of the paper, and its claims as true or false",
        "studies",
        ("optuna",),
    ),
    "tune": Subcommand(
        "hcbf_lab.tuning.command",
        "the weights (γ₀, Δγ) by sampling",
        "studies",
        ("optuna",),
    ),
    "play": Subcommand(
        "hcbf_lab.play.command",
        "a playground in the browser: steer, drag regions, push",
        "play",
        ("viser",),
    ),
}
