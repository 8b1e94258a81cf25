"""The commands of studies, which the entry points of `hcbf.commands` name."""

from hcbf_gym.arguments import Subcommand

COMMANDS = {
    "certify": Subcommand(
        "hcbf_gym.evaluation.certification.command",
        "how often a plant enters rank 1 at most: margins measured, then a bound",
    ),
    "reproduce": Subcommand(
        "hcbf_gym.studies.reproduction.command",
        "every figure of the paper, and its claims as true or false",
        "studies",
        ("optuna",),
    ),
    "tune": Subcommand(
        "hcbf_gym.studies.tuning.command",
        "the weights (γ₀, Δγ) by sampling",
        "studies",
        ("optuna",),
    ),
    "play": Subcommand(
        "hcbf_gym.play.command",
        "a playground in the browser: steer, drag regions, push",
        "play",
        ("viser",),
    ),
}
