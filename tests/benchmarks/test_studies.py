"""Studies in small: what their pages state holds, and what they measure is what they name."""

import json

import numpy as np
import pytest
from needs import needs

from benchmarks import map_guidance, noisy_velocity, uncertain
from benchmarks.suites import estimation, held_rows
from benchmarks.suites import monte_carlo as command
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_robots.maps import MapClass, RankedMap


@needs("jax")  # of vehicles and the own model
@pytest.mark.parametrize("error", uncertain.ERRORS)
@pytest.mark.parametrize("name", uncertain.NAMES)
@pytest.mark.filterwarnings("ignore")
def test_with_wrong_estimates_no_region_is_entered_under_a_calm_status(name, error):
    count = uncertain.run(uncertain.cases()[name], error, steps=2000, seed=0)
    assert count.entered == 0
    assert count.calm > 0.6 * count.steps
    assert count.least < 1.0  # the policy does drive at the regions


@pytest.mark.parametrize("policy", held_rows.POLICIES)
def test_under_held_rows_no_policy_passes_a_strict_barrier(policy):
    result = held_rows.walk_all("random-moving", policy, "held", 10)
    assert (result["entered"], result["violated"]) == (0, 0)
    assert result["gap"] < 1e-12  # what is followed here is what the environment did
    assert result["least_speed_h"] >= 0.0
    assert set(held_rows.tables({"held_rows": [result]})) == {"held-rows"}


def test_the_usual_rows_let_pd_pass_the_speed_limit_between_samples():
    assert held_rows.walk_all("random", "pd", "usual", 10)["least_speed_h"] < 0.0


def test_a_corridor_is_walked_and_a_zone_left_on_the_path_of_the_field():
    floor, (start, goal) = map_guidance.corridor(0.0)
    zone = np.zeros(floor.grid.shape, dtype=np.bool_)
    column = round(floor.grid.to_cells(start[None])[0, 0])
    zone[:, : column + 10] = True  # from the start half a metre towards the goal
    zoned = RankedMap(floor.grid, (*floor.classes, MapClass("zone", 2, "keepout", zone)))
    through = map_guidance.walk(floor, "rom", tuple(start), tuple(goal))
    assert through.arrived
    assert (through.entered, through.out, through.length) == (False, 0.0, 0.0)
    left = map_guidance.walk(zoned, "rom", tuple(start), tuple(goal), until_out=True)
    assert left.length == pytest.approx(0.5, abs=0.1)
    assert 0.0 < left.out < 5.0


def test_noise_of_positions_alone_raises_no_alarm_of_inputs():
    assert noisy_velocity.alarmed(0.0, filters=False) == 0


def walks(scale, n=50, steps=200):
    rng = np.random.default_rng(0)
    nees = scale * rng.chisquare(4, (n, steps))
    return [estimation.Walk(np.full(steps, 4e-4), np.full(steps, 9e-4), row, False) for row in nees]


def test_honest_covariances_are_in_the_band_and_others_are_not():
    assert estimation._row("honest", walks(1.0))["share_inside"] == pytest.approx(0.95, abs=0.04)
    assert estimation._row("overconfident", walks(2.0))["share_inside"] < 0.05
    assert estimation._row("cautious", walks(0.5))["share_inside"] < 0.05


def test_an_episode_with_a_fall_counts_as_a_fall_alone():
    fallen = estimation.Walk(np.full(7, 100.0), np.full(7, 100.0), np.full(7, 100.0), True)
    row = estimation._row("mixed", [*walks(1.0, n=3), fallen])
    assert (row["fell"], row["episodes"]) == (1, 4)
    assert row["position_rms"] == pytest.approx(0.02)
    assert estimation.tables({"rows": [row]})["all"].rows[0][1] == "2.00 cm"


@pytest.mark.physics
def test_a_walk_reports_every_step():
    (walk,) = estimation.walk({"drift": 0.01}, [0], steps=20)
    assert len(walk.position) == len(walk.velocity) == len(walk.nees) == 20
    assert not walk.fell
    assert (walk.nees > 0.0).all()


def arguments(folder, **changes):
    few = {"episodes": 5, "chunk": 2, "policies": ("pd",), "programs": ("r 5", "lex"), "workers": 1}
    return command.Args(output=folder, **(few | changes))


def test_a_broken_run_resumes_and_ends_with_the_same_result(tmp_path):
    command.main(arguments(tmp_path))
    first = (tmp_path / "summary.json").read_text()
    assert [row["episodes"] for row in json.loads(first)] == [5, 5]
    lost, *kept = (tmp_path / "chunks").iterdir()
    stamps = {path: path.stat().st_mtime_ns for path in kept}
    assert len(kept) == 5
    lost.unlink()
    (tmp_path / "summary.json").unlink()
    command.main(arguments(tmp_path))
    assert (tmp_path / "summary.json").read_text() == first
    assert stamps == {path: path.stat().st_mtime_ns for path in kept}


def test_a_folder_of_another_study_is_left_alone(tmp_path):
    command.main(arguments(tmp_path, episodes=2, programs=("lex",)))
    before = (tmp_path / "summary.json").read_text()
    with pytest.raises(InvalidInputError, match="seed"):
        command.main(arguments(tmp_path, seed=1))
    assert (tmp_path / "summary.json").read_text() == before


def test_senseless_arguments_are_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="lex"):
        command.main(arguments(tmp_path, programs=("hope",)))
    with pytest.raises(InvalidInputError, match="episodes"):
        command.main(arguments(tmp_path, episodes=0))
