"""How a walker follows is measured: on a response that is known, and on the carts."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Box
from hcbf_robots import Response, Walker
from hcbf_robots.identification import command
from hcbf_robots.identification.analysis import delayed, fit, respond
from hcbf_robots.identification.identify import identify
from hcbf_robots.walkers.walker_margins import braked, uncertainty

PERIOD = 0.02


@settings(max_examples=10)
@given(
    gain=st.floats(0.4, 1.2),
    time_constant=st.floats(0.05, 0.4),
    steps=st.integers(0, 6),
    seed=st.integers(0, 100),
)
def test_a_known_response_is_found_beneath_an_oscillation(gain, time_constant, steps, seed):
    rng = np.random.default_rng(seed)
    commanded = np.repeat(rng.uniform(-1.0, 1.0, 40), 50)
    delay = steps * PERIOD
    done = gain * respond(delayed(commanded, delay, PERIOD), time_constant, PERIOD)
    wave = 0.1 * np.sin(2.0 * np.pi * 1.5 * PERIOD * np.arange(len(commanded)))
    found = fit(commanded, done + wave, PERIOD)
    assert found.gain == pytest.approx(gain, rel=0.05)
    assert found.delay + found.time_constant == pytest.approx(delay + time_constant, abs=0.04)


def test_a_response_from_rest_is_the_exact_solution():
    commanded = np.ones(50)
    expected = 1.0 - np.exp(-PERIOD * np.arange(50) / 0.2)
    np.testing.assert_allclose(respond(commanded, 0.2, PERIOD), expected, atol=1e-12)


@pytest.mark.physics
@pytest.mark.parametrize("name", ["cart", "holonomic-cart"])
def test_the_shipped_carts_are_as_their_files_say(name):
    """The file beside the contract is what the command measures, within what a shorter run can."""
    walker = Walker.load(name)
    shipped, measured = walker.response, identify(walker, 20.0, 7).response
    assert shipped is not None
    assert measured.complaints == []
    assert measured.braking == pytest.approx(shipped.braking, rel=0.02)
    assert measured.time_constant + measured.delay == pytest.approx(shipped.follows, abs=0.02)
    np.testing.assert_allclose(measured.gain, shipped.gain, atol=0.05)


def test_the_command_writes_beside_the_contract_or_to_a_folder(tmp_path, capsys):
    command.main(command.Args("holonomic-cart", seconds=10.0, output=tmp_path))
    printed = capsys.readouterr().out
    assert "brakes at" in printed
    assert (tmp_path / "holonomic-cart.response.png").stat().st_size > 10_000
    data = json.loads((tmp_path / "holonomic-cart.response.json").read_text())
    assert data["falls"] == 0
    response = Response.load(tmp_path / "holonomic-cart.response.json")
    assert response.seconds == 10.0


def test_a_robot_of_the_package_is_left_as_it_ships(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = Walker.load("cart").response_file
    before = shipped.read_bytes()
    command.main(command.Args("cart", seconds=10.0))
    assert shipped.read_bytes() == before != (tmp_path / shipped.name).read_bytes()


def test_a_run_that_is_too_short_is_refused():
    with pytest.raises(InvalidInputError, match="seconds"):
        command.main(command.Args("cart", seconds=1.0))


NUMBERS = {
    "gain": [1.0, 0.9, 1.0],
    "time_constant": 0.1,
    "delay": 0.02,
    "residual": [0.05, 0.14, 0.3],
    "deviation": 0.03,
    "overshoot": 0.1,
    "rise": 0.3,
    "stopping": 0.2,
    "braking": 4.0,
    "falls": 0,
    "seconds": 60.0,
}


def test_a_robot_that_does_not_follow_is_named():
    complaints = Response(**(NUMBERS | {"gain": [1.0, 0.4, 1.0], "falls": 2})).complaints
    assert len(complaints) == 2
    assert "entry 1" in complaints[0]
    assert "fell 2 times" in complaints[1]
    assert Response(**NUMBERS).complaints == []


@pytest.mark.parametrize("name", ["time_constant", "delay", "overshoot"])
def test_a_worse_robot_keeps_more(name):
    better = uncertainty(Response(**NUMBERS), PERIOD)
    worse = uncertainty(Response(**(NUMBERS | {name: 2.0 * NUMBERS[name]})), PERIOD)
    assert all(w >= b for w, b in zip(worse, better, strict=True))
    assert worse != better


def test_no_input_is_harder_than_the_robot_brakes():
    response = Response(**NUMBERS)
    assert braked(Box.symmetric(5.0), response).radius == pytest.approx(4.0)
    assert braked(Box.symmetric(1.0), response).radius == Box.symmetric(1.0).radius


@pytest.mark.parametrize(
    "malformed", [{"braking": 0.0}, {"gain": "much"}, {"delay": -1.0}, {"x": 1}]
)
def test_a_malformed_response_is_refused(tmp_path, malformed):
    path = tmp_path / "one.response.json"
    path.write_text(json.dumps(NUMBERS | malformed))
    with pytest.raises(InvalidInputError, match="response"):
        Response.load(path)
