"""The knowledge of a robot: reduced-order models ẋ = f(x) + g(x)u, input sets U and plants."""

from hcbf_gym._core import Reason
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.control_affine import ControlAffine
from hcbf_gym.models.input_sets import Ball, Box, InputSet
from hcbf_gym.models.plant import Coverage, CoveredBy, Estimate, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel, SingleIntegrator
from hcbf_gym.models.vehicles import KinematicBicycle, Unicycle

__all__ = [
    "Axle",
    "Ball",
    "Box",
    "ControlAffine",
    "Coverage",
    "CoveredBy",
    "DoubleIntegrator",
    "Estimate",
    "InputSet",
    "KinematicBicycle",
    "Plant",
    "Reason",
    "ReducedOrderModel",
    "SingleIntegrator",
    "Uncertainty",
    "Unicycle",
]
