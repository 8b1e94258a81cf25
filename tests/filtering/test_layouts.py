"""Records of the compiled core and of NumPy are one layout."""

import pytest

from hcbf_gym import _core
from hcbf_gym.filtering import plants, report


@pytest.mark.parametrize(
    ("offsets", "dtype", "behind"),
    [
        (_core.plant_offsets, plants.plant_dtype(3), ("input", "stop")),
        (_core.report_offsets, report.plant_dtype(3), ("u_nominal", "u_safe")),
        (_core.report_row_offsets, report.ROW, ()),
        (_core.constants_offsets, plants.CONSTANTS, ()),
    ],
)
def test_fields_stand_where_the_core_reads_them(offsets, dtype, behind):
    *fields, (_, size) = offsets()
    names = [name for name, _ in fields]
    assert names == [name for name in dtype.names if name not in behind]
    assert fields == [(name, dtype.fields[name][1]) for name in names]
    ends = [size + 8 * 3 * k for k in range(len(behind) + 1)]
    assert [dtype.fields[name][1] for name in behind] == ends[:-1]
    assert dtype.itemsize == ends[-1]
