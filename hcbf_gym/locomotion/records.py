"""Records that the compiled controller and Python share; `core/include/hcbf/` has their fields."""

from hcbf_gym.arrays import record_type

GAIT = record_type("Gait")
LEGS = record_type("LegGeometry")
BODIES = record_type("Bodies")
REFERENCE = record_type("BodyReference")
TARGETS = record_type("FootTargets")
SETTINGS = record_type("locomotion_tick.Settings")
MEMORY = record_type("locomotion_tick.Memory")
WORKSPACE = record_type("Workspace")
