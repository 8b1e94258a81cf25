"""What stands between u* and u, without Gymnasium.

In the order of a step: `belief` says which state is believed, the rows of `barriers` are made, a
program of `programs` answers, `verdict` says what the answer may be called, `report` says it to the
user. `monitor` compares what the plant does with what was chosen; `brake` answers where nothing is
believed. `planar_core` runs all of it for planar double integrators in one compiled call,
`general_core` for any model.
"""
