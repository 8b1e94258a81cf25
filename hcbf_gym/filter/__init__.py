"""The filter between u* and u, without Gymnasium: one core for N plants of any model.

`core` has the order of a step. `samples` and `scenes` take states and barriers, and `bound` calls
the compiled core once (`core/include/hcbf/`): `state_check` decides which states are valid, `step`
makes rows, `monitor` compares measured with predicted motion, a program chooses u, and `conclusion`
sets the status. For other models than the planar double integrator, `model_rows` makes rows, alarms
and braking inputs before.
"""
