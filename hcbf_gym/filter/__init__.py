"""What stands between u* and u, without Gymnasium: one core for N plants of any model.

In the order of a step: `samples` takes what is given, and `report` returns what was found. Between
them stands one call of the compiled core (`core/include/hcbf/`): `state_check` decides which state
is valid, `step` makes rows, `monitor` compares what a plant does with what was chosen, a program
answers, `conclusion` judges the answer. Of models other than the planar double
integrator `model_core` makes rows, alarms and braking inputs first. `core` is what both share.
"""
