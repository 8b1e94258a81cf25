"""Records of a robot's monitors that Python and the compiled core share."""

import pytest

from hcbf_gym import _core
from hcbf_gym.online import motion_monitor
from hcbf_gym.robots import command_history

MODULES = {"command_history": command_history, "motion_monitor": motion_monitor}


@pytest.mark.parametrize(("name", "layout"), _core.robot_layouts().items())
def test_a_record_is_laid_out_in_python_as_in_cpp(name, layout):
    module, _, record = name.partition(".")
    dtype = vars(MODULES[module])[record]
    size, offsets = layout
    assert dtype.itemsize == size
    assert {field: dtype.fields[field][1] for field in dtype.names} == offsets
