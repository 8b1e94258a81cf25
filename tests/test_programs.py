import numpy as np
import pytest

from hcbf_gym import programs
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.programs import CbfRows, FilterStatus


def rows_of(a, b, priority, h=None, alpha2_psi=None):
    a = np.array(a, dtype=float)
    b = np.array(b, dtype=float)
    h = np.ones(b.size) if h is None else np.array(h, dtype=float)
    psi = None if alpha2_psi is None else np.array(alpha2_psi, dtype=float)
    return CbfRows(a, b, h, np.array(priority), psi)


@pytest.mark.parametrize("name", programs.names())
def test_an_input_that_meets_every_row_is_left_alone(name):
    rows = rows_of([[1.0, 0.0], [0.0, 2.0]], [-3.0, -4.0], [1, 2])
    result = programs.make(name)(np.array([1.0, -1.5]), rows)
    np.testing.assert_array_equal(result.u, [1.0, -1.5])
    assert result.status is FilterStatus.NOMINAL
    assert not result.slack.any()


@pytest.mark.parametrize("name", programs.names())
def test_unknown_options_and_solvers_are_refused_with_the_choices(name):
    with pytest.raises(InvalidInputError, match="expected among"):
        programs.make(name, gamma=1.0)
    with pytest.raises(UnknownNameError, match="daqp"):
        programs.make(name, solver="oracle")
