"""Every reason to brake, whichever there are."""

from pathlib import Path

import pytest

from hcbf_gym import _core
from hcbf_gym.models import Reason

DOCS = Path(__file__).parents[2] / "docs"
PAGES = "".join((DOCS / name).read_text() for name in ("failing_closed.md", "gatekeeper.md"))


def test_reasons_count_from_none_and_have_words_of_their_own():
    assert [int(reason) for reason in Reason] == list(range(len(Reason)))
    assert Reason.NONE.text == ""
    assert len({reason.text for reason in Reason}) == len(Reason)


@pytest.mark.parametrize("reason", [one for one in Reason if one != Reason.NONE])
def test_a_reason_is_in_words_and_on_a_page(reason):
    assert len(reason.text.split()) > 2
    assert not reason.text.endswith(".")
    assert f"`{reason.name}`" in PAGES
    assert reason.lasts is (
        reason >= _core.FIRST_ALARM and reason not in (Reason.MOVES, Reason.UNVERIFIED)
    )
