import pytest

from tests.maps.bent import bend


@pytest.mark.filterwarnings("ignore:map .* are not read", "ignore:.*beyond the map")
@pytest.mark.parametrize("first", [0, 40])
def test_a_bent_map_is_refused_in_words_or_read_right(tmp_path, first):
    read = 0
    for number in range(first, first + 40):
        folder = tmp_path / str(number)
        folder.mkdir()
        read += bend(number, folder)
    assert 0 < read < 40
