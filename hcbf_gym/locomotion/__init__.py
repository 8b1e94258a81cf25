"""From a planar acceleration to joint torques, as the lower half of the paper's Fig. 2.

``model → gait → footholds → swing → tasks → QP → impedance``: one file each, in this order put
together in `controller`.
"""
