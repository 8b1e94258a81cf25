"""Locomotion: from a planar acceleration to joint torques, the lower half of the paper's Fig. 2.

The stages are ``model → gait → footholds → swing → tasks → QP → impedance``. The core runs them in
this order in one tick, see `core/include/hcbf/locomotion_tick.hpp`; `controller` calls it.
"""
