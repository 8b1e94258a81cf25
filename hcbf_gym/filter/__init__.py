"""What stands between u* and u, without Gymnasium: one core for N plants of any model.

In the order of a step, which `core` has: `samples` and `scenes` take what is given, and `bound`
makes one call of the compiled core (`core/include/hcbf/`): `state_check` decides which state is
valid, `step` makes rows, `monitor` compares what a plant does with what was chosen, a program
answers, `conclusion` judges the answer. Of models other than the planar double integrator
`model_rows` makes rows, alarms and braking inputs first.
"""
