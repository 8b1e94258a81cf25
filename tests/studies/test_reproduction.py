import importlib
import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hcbf_gym.arguments import check
from hcbf_gym.cli import commands
from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.output_folder import open_folder, write_json
from hcbf_gym.scenarios import BoxObstacle
from hcbf_lab.reproduction import figure5, figures67
from hcbf_lab.tuning import Samples

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def rom():
    return figure5.simulate_rom()


def test_every_claim_of_figure_5_holds_on_the_reduced_order_model(rom):
    claims = figure5.claims_of("ROM", rom)
    assert len(claims) == 6
    assert all(claims.values()), claims


def test_the_claims_of_figure_5_fail_on_runs_that_contradict_them(rom):
    swapped = {
        setting: replace(episode, min_h=episode.min_h - 2.0, fell=True)
        for setting, episode in zip(rom, reversed(rom.values()), strict=True)
    }
    assert not any(figure5.claims_of("ROM", swapped).values())


@pytest.mark.parametrize(
    ("cost", "holds"),
    [(lambda g: (g - 3.0) ** 2, True), (lambda g: g, False), (lambda g: -g, False)],
)
def test_a_valley_is_found_where_there_is_one_and_nowhere_else(cost, holds):
    grid = np.meshgrid(np.linspace(0, 5, 41), figure5.DELTA_GAMMA_GRID)
    gamma0, delta_gamma = (values.ravel() for values in grid)
    samples = Samples(gamma0, delta_gamma, cost(gamma0) + 0.01 * delta_gamma)
    assert all(figure5.map_claims_of("ROM", samples).values()) is holds


@pytest.mark.physics
def test_r_brushes_the_box_that_h_avoids_and_both_reach_the_goal():
    jobs = figures67.undisturbed_jobs()
    episodes = [jobs[name].run() for name in ("R", "H")]
    claims = figures67.claims_of(dict(zip(("R", "H"), episodes, strict=True)))
    assert len(claims) == 7
    assert all(claims.values()), claims


def test_the_force_on_a_box_is_that_of_the_tick_in_which_it_acts():
    box = BoxObstacle("box", center=(0.3, 0.0), size=(0.2, 0.6, 0.3), mass=1.0)
    plant = A1Physics(obstacles=(box,))
    plant.reset(np.zeros(2), 0.0, np.random.default_rng(0))
    model, geom, wrench, felt = plant.model, plant.model.geom("box").id, np.zeros(6), 0.0
    for _ in range(20):
        solved = mujoco.MjData(model)
        mujoco.mj_copyData(solved, model, plant.data)
        solved.ctrl[:] = 0.0
        mujoco.mj_forward(model, solved)
        expected = 0.0
        for index in range(solved.ncon):
            pair = solved.contact[index].geom
            if geom in pair and model.geom_bodyid[pair].all():  # the floor is body 0
                mujoco.mj_contactForce(model, solved, index, wrench)
                expected += wrench[0]
        plant.step(np.zeros(12))
        np.testing.assert_allclose(plant.obstacle_forces(), [expected], rtol=1e-9)
        felt = max(felt, expected)
    assert felt > 10.0


def test_a_folder_opens_for_its_own_study_and_no_other(tmp_path):
    settings = {"study": "tuning", "mean": (3.0, 1.5), "seed": 0}
    folder = tmp_path / "new" / "folder"
    open_folder(folder, settings)
    write_json(folder / "result.json", {"kept": True})
    open_folder(folder, settings)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InvalidInputError, match=r"another study, which differs in \['seed'\]"):
        open_folder(folder, settings | {"seed": 1})
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_folder_with_other_files_and_a_file_are_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    for place in (tmp_path, tmp_path / "thesis.tex"):
        with pytest.raises(InvalidInputError, match="expected"):
            open_folder(place, {"study": "tuning"})
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("text", ["{", "[]", '{"study": "other"}'])
def test_settings_that_are_broken_or_foreign_are_refused(tmp_path, text):
    (tmp_path / "settings.json").write_text(text)
    with pytest.raises(InvalidInputError, match="expected"):
        open_folder(tmp_path, {"study": "tuning"})
    assert (tmp_path / "settings.json").read_text() == text


@pytest.mark.parametrize(
    ("script", "arguments", "message"),
    [
        ("tune", {"covariance": ((1.0, 2.0), (2.0, 1.0))}, "positive semidefinite"),
        ("tune", {"program": "cbf-qp"}, "takes gamma0"),
        ("tune", {"samples": 0}, "samples: got 0, expected"),
        ("tune", {"scenario": "moon"}, "unknown scenario"),
        ("tune", {"w_f": -1.0}, "w-f"),
        ("tune", {}, "another study"),
        ("reproduce", {"workers": 0}, "workers"),
        ("reproduce", {}, "another study"),
    ],
)
def test_the_commands_refuse_bad_input_and_touch_nothing(tmp_path, script, arguments, message):
    open_folder(tmp_path, {"study": "something else"})
    module = importlib.import_module(commands()[script].module)
    args = module.Args(output=tmp_path, **arguments)

    def run():
        check(args)
        module.main(args)

    with pytest.raises(InvalidInputError, match=message):
        run()
    assert [path.name for path in tmp_path.iterdir()] == ["settings.json"]
    assert json.loads((tmp_path / "settings.json").read_text()) == {"study": "something else"}
