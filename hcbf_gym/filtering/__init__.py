"""What stands between u* and u, without Gymnasium: one core for N plants of any model.

In the order of a step: `samples` takes what is handed over, `belief` says which state is believed,
the rows of `barriers` are made, a program of `programs` answers, `verdict` says what the answer may
be called, `report` says it to the user. `monitor` compares what a plant does with what was chosen.
`step` runs all of it in one compiled call for planar double integrators; of other models
`model_core` makes rows, alarms and braking inputs first. `core` is what both share.
"""
