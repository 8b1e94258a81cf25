"""Records that Python and the compiled core share."""

import pytest

from benchmarks.judges import task_space
from hcbf_gym import _core
from hcbf_gym.estimation import records as estimation
from hcbf_gym.locomotion import records as locomotion

LAYOUTS = [
    *((*record, (locomotion, task_space)) for record in _core.locomotion_layouts().items()),
    *((*record, (estimation,)) for record in _core.estimation_layouts().items()),
]


@pytest.mark.parametrize(("name", "layout", "modules"), LAYOUTS)
def test_a_record_lies_in_python_as_it_does_in_cpp(name, layout, modules):
    (dtype,) = (vars(module)[name] for module in modules if name in vars(module))
    size, offsets = layout
    assert dtype.itemsize == size
    assert {field: dtype.fields[field][1] for field in dtype.names} == offsets
