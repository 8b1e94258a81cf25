"""Policies and environments of one's own in the evaluation: the same numbers as by hand."""

import json
import shutil
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from by_hand import by_hand
from matplotlib.figure import Figure
from needs import remedy

from hcbf_gym import barriers, cli, wrappers
from hcbf_gym.drawing import scene_plot
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation import episode_plot, output_folder, own_environment
from hcbf_gym.evaluation.recorded import rollout
from hcbf_gym.evaluation.rollouts import Case

ROOT = Path(__file__).parents[2]
ROM = "HCBF-Regions-v0"
BOAT = f"{ROOT / 'examples' / 'boat.py'}:certify"

OWN = """
import numpy as np

def act(observation, info):
    return 2.0 * observation[:2] + 3.0 * observation[2:4]

def ahead(observation, info):
    return np.array([2.0, 0.5])

def gives_nan(observation, info):
    return np.full(2, np.nan)
"""


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    return str(tmp_path / "own.py")


def evaluated(output, *arguments):
    cli.main(["evaluate", "--workers", "1", "--output", str(output), *map(str, arguments)])
    return json.loads((output / "summary.json").read_text(encoding="utf-8"))


def test_a_function_gives_the_numbers_that_a_loop_by_hand_gives(own, tmp_path):
    policy = f"{own}:act"
    arguments = ["--env", ROM, "--scenario", "random", "--program", "lex-cbf-qp", "--episodes", 2]
    found = evaluated(tmp_path / "out", *arguments, "--policy", policy, "--guidance", "geodesic")
    env = gym.make(ROM, scenario="random")
    env = wrappers.SafetyFilter(env, "lex-cbf-qp", guidance="geodesic")
    for seed, episode in enumerate(found["episodes"]):
        hand = by_hand(
            env, lambda o, i: 2.0 * o[:2] + 3.0 * o[2:4], seed=seed, steps=1000
        )  # fmt: skip
        assert (episode["return"], episode["intervention_rms"]) == pytest.approx(hand, rel=1e-12)
    (row,) = found["aggregate"]
    assert row["reached"] == 1.0
    low, high = row["intervals"]["reached"]
    assert 0.0 < low < high == 1.0
    assert row["intervals"]["return"][0] < row["return"] < row["intervals"]["return"][1]
    assert 0.9 < row["entered_at_most"] < 1.0  # two episodes say little
    assert found["settings"]["policy"] == [policy]
    assert found["settings"]["versions"]["numpy"] == np.__version__


def test_an_environment_of_ones_own_gives_the_numbers_that_a_loop_by_hand_gives(own, tmp_path):
    arguments = ["--env", BOAT, "--policy", f"{own}:ahead", "--program", "none", "lex-cbf-qp"]
    found = evaluated(tmp_path / "out", *arguments, "--steps", 60, "--seed", 3, "--figures", "svg")
    none, filtered = found["episodes"]
    env, plant = own_environment.make(BOAT)
    env = wrappers.SafetyFilter(env, "lex-cbf-qp", plant=plant)
    hand = by_hand(env, lambda o, i: np.array([2.0, 0.5]), seed=3, steps=60)
    assert (filtered["return"], filtered["intervention_rms"]) == hand
    assert none["intervention_rms"] == 0.0
    assert none["seconds"] == filtered["seconds"] == pytest.approx(3.0)
    assert found["barriers"][-1] == {"name": "speed", "priority": 1}
    assert none["min_h"][-1] < 0.0 < filtered["min_h"][-1] + 0.05
    assert found["aggregate"][0]["reached"] is None
    figures = sorted((tmp_path / "out").glob("*.svg"))
    assert len(figures) == 2
    assert all(b"<svg" in figure.read_bytes() for figure in figures)


def test_h_that_a_rollout_records_is_that_of_the_states_it_went_through(own):
    episode = Case(BOAT, None, f"{own}:ahead", "lex-cbf-qp", {}, steps=40).run(0)
    env, _ = own_environment.make(BOAT)
    env.reset(seed=0)
    for x, h in zip(episode.state, episode.h, strict=True):
        np.testing.assert_allclose(h, [b.h(x) for b in env.unwrapped.buoys], atol=1e-12)
    assert (episode.min_h <= episode.h + 1e-12).all()
    np.testing.assert_array_equal(episode.position, episode.state[:, :2])
    assert np.isfinite(episode.psi).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "OWN:gives_nan"], "expected finite numbers"),
        (["--policy", "OWN:act", "OWN:nothing"], "AttributeError"),
        (["--env", BOAT, "--v-max", "1.0"], "whose plant decides all that"),
        (["--env", BOAT, "--policy", "pd"], "expected one of your own"),
        (["--env", ROM, "--body", "footprint"], "expected --env HCBF-A1Regions-v0"),
        (["--env", BOAT, "--scenario", "random"], "whose plant decides all that"),
        (["--env", ROM, "--scenario", "random", "--map", "a"], "expected one of them"),
        (["--policy", "hcbf_gym.barriers:Disc"], "class without arguments"),
        (["--env", "HCBF-Nowhere-v0"], "file.py:function"),
        (["--env", ROM, "--masks", "keepout.yaml", "2"], "--map"),
        (
            ["--env", ROM, "--map", "a.yaml", "--masks", "b.yaml", "2", "--slow", "b.yaml", "1"],
            "once",
        ),
    ],
)
def test_bad_input_is_refused_before_the_first_episode(own, tmp_path, arguments, message):
    given = [one.replace("OWN", own) for one in arguments]
    given = given if "--env" in given else ["--env", ROM, *given]
    with pytest.raises(SystemExit, match=message):
        evaluated(tmp_path / "out", *given)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_another_run_is_not_overwritten_unasked(own, tmp_path):
    first = ["--env", ROM, "--program", "none", "--steps", 5, "--policy", f"{own}:act"]
    evaluated(tmp_path / "out", *first)
    before = (tmp_path / "out" / "summary.json").read_bytes()
    evaluated(tmp_path / "out", *first)  # the same run may go on
    with pytest.raises(SystemExit, match=r"another study.*seed.*--overwrite"):
        evaluated(tmp_path / "out", *first, "--seed", 1)
    assert (tmp_path / "out" / "summary.json").read_bytes() == before
    with open(own, "a", encoding="utf-8") as file:
        file.write("\n# another policy\n")
    with pytest.raises(SystemExit, match="files"):
        evaluated(tmp_path / "out", *first)
    found = evaluated(tmp_path / "out", *first, "--seed", 1, "--overwrite")
    assert found["seeds"] == [1, 1]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("kept", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"other files.*--overwrite"):
        evaluated(tmp_path / "mine", *first)
    evaluated(tmp_path / "mine", *first, "--overwrite")
    (tmp_path / "mine" / "settings.json").write_text("{", encoding="utf-8")
    evaluated(tmp_path / "mine", *first, "--overwrite")
    assert (tmp_path / "mine" / "notes.txt").read_text(encoding="utf-8") == "kept"


@pytest.mark.parametrize("content", [b"{", b"\xff", b"[1]", b'{"seed": 1}', b""])
def test_only_overwrite_replaces_the_settings_of_another_study(tmp_path, content):
    file = tmp_path / "settings.json"
    file.write_bytes(content)
    for overwrite, choices in (
        (None, "another --output"),
        (False, "another --output.*--overwrite"),
    ):
        with pytest.raises(InvalidInputError, match=choices):
            output_folder.open_folder(tmp_path, {"seed": 0}, overwrite)
        assert file.read_bytes() == content
    output_folder.open_folder(tmp_path, {"seed": 0}, overwrite=True)
    assert json.loads(file.read_text(encoding="utf-8")) == {"seed": 0}


@pytest.mark.parametrize("overwrite", [None, False, True])
def test_a_folder_in_the_place_of_the_settings_is_refused(tmp_path, overwrite):
    (tmp_path / "settings.json").mkdir()
    with pytest.raises(InvalidInputError, match="delete it"):
        output_folder.check_folder(tmp_path, {"seed": 0}, overwrite)


def test_a_cap_on_the_speed_is_one_in_random_scenes_too(own, tmp_path):
    arguments = ["--env", ROM, "--scenario", "random", "--program", "lex-cbf-qp", "--steps", 150]
    scenes = []
    for cap in (None, 0.4):
        case = Case(ROM, "random", f"{own}:act", "lex-cbf-qp", {}, v_max=cap, steps=100)
        episode = case.run(7)
        scenes.append(episode.position[0])
        assert (np.hypot(*episode.state[:, 2:].T).max() <= 0.4) == (cap is not None)
    np.testing.assert_array_equal(*scenes)
    found = evaluated(tmp_path / "out", *arguments, "--v-max", 0.4)
    assert found["settings"]["v_max"] == 0.4


def test_a_rollout_without_a_plant_is_refused():
    env, _ = own_environment.make(BOAT)
    with pytest.raises(InvalidInputError, match="plant=Plant"):
        rollout(env, lambda o, i: np.zeros(2), 0)


def test_own_labels_and_programs_are_drawn(own):
    episode = Case(ROM, "paper-simulation", "pd", "none", steps=20).run(0)
    scene = gym.make(ROM, scenario="paper-simulation").unwrapped.scenario
    labelled = {("mine", "my program"): episode, ("mine", "none"): episode}
    paths, series = episode_plot.plot_paths(scene, labelled), episode_plot.plot_series(labelled)
    for figure in (paths, series):
        assert figure._repr_png_()[:4] == b"\x89PNG"
    written = [text.get_text() for text in paths.axes[0].texts]
    assert set(written) == {barrier.name for barrier in scene.barriers}
    assert "h of h4 region 2\n(rank 2) [m]" in [axes.get_ylabel() for axes in series.axes]
    figure = episode_plot.plot_episode(
        episode, scene.barriers, "t", {"h4 region 2": "the pond"}, ("ax [m/s²]", "ay [m/s²]")
    )
    texts = [text.get_text() for axes in figure.axes for text in _texts(axes)]
    assert {"the pond", "ax [m/s²]", "h, rank 2"} <= set(texts)


def test_regions_that_move_are_drawn_where_they_are_later_too():
    episode = Case(ROM, "trolley", "pd", "lex-cbf-qp", {}).run(0)
    scene = gym.make(ROM, scenario="trolley").unwrapped.scenario
    figure = episode_plot.plot_paths(scene, {("pd", "lex-cbf-qp"): episode})
    written = {text.get_text() for text in figure.axes[0].texts}
    assert written >= {"trolley,\nt = 0", "gate", "wall", "lawn", "t = 5 s", "t = 10 s"}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "robot at t = 5, 10 s" in labels
    assert len(episode_plot.plot_series({("pd", "lex-cbf-qp"): episode}).axes) == 5 + 1 + 1
    assert episode.summary()["task"] == "track"


def test_a_condition_without_an_outline_is_drawn_where_it_is_below_zero():
    pytest.importorskip("jax", reason=remedy("jax"))
    inside = barriers.Function("mine", 1, lambda x, t: (x[0] - x[2]) ** 2 + x[1] ** 2 - 1.0)
    axes = Figure().add_subplot()
    axes.set(xlim=(-3.0, 3.0), ylim=(-3.0, 3.0))
    filled, border = scene_plot.draw_barriers(axes, [inside], 0.0, np.array([0.0, 0.0, 0.5]))
    for drawn in (filled, border):
        low, high = (f(drawn.get_paths()[0].vertices, axis=0) for f in (np.min, np.max))
        np.testing.assert_allclose([low, high], [[-0.5, -1.0], [1.5, 1.0]], atol=0.02)
    assert scene_plot.draw_barriers(axes, [inside]) == []  # the robot's position is not known
    far = np.array([0.0, 0.0, 9.0])
    assert scene_plot.draw_barriers(axes, [inside], 0.0, far) == []


def _texts(axes):
    legend = axes.get_legend()
    return [axes.yaxis.label, *(legend.get_texts() if legend else ())]


def certified(output, plant, policy, *arguments):
    words = [
        "certify",
        plant,
        "--policies",
        policy,
        "nearest",
        "slam",
        "--bound",
        "0.4",
        "--calibration",
        "0",
    ]
    words += ["--workers", "1", "--steps", "40", "--output", str(output), *arguments]
    cli.main(words)
    (file,) = (path for path in output.glob("*.json") if path.name != "settings.json")
    return json.loads(file.read_text(encoding="utf-8"))


@pytest.mark.parametrize("plant", ["regions", BOAT])
def test_a_certificate_is_of_a_policy_of_ones_own(own, tmp_path, plant):
    name = "act" if plant == "regions" else "ahead"
    found = certified(tmp_path / "out", plant, f"{own}:{name}")
    policies = {stratum["policy"] for stratum in found["strata"]}
    assert policies == {f"{own}:{name}", "nearest", "slam"}
    assert found["entered"] == 0


def test_a_policy_that_cannot_act_is_refused_before_it_is_certified(own, tmp_path):
    with pytest.raises(SystemExit, match="expected finite numbers"):
        certified(tmp_path / "out", "regions", f"{own}:gives_nan")
    assert not (tmp_path / "out").exists()


def test_ctrl_c_prints_how_to_resume(monkeypatch, capsys):
    def stopped(args):
        raise KeyboardInterrupt

    monkeypatch.setattr("hcbf_gym.evaluation.command.main", stopped)
    with pytest.raises(SystemExit):
        cli.main(["evaluate"])
    assert capsys.readouterr().err == "interrupted; the same command resumes this run\n"


def test_without_a_folder_every_run_has_another_and_the_same_run_its_old_one(
    own, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for seed, folder in ((0, "evaluate"), (1, "evaluate-2"), (0, "evaluate"), (2, "evaluate-3")):
        arguments = f"--env {ROM} --policy {own}:act --program none --steps 2 --workers 1"
        cli.main(["evaluate", *arguments.split(), "--seed", str(seed)])
        path = tmp_path / "results" / folder / "summary.json"
        assert json.loads(path.read_text(encoding="utf-8"))["seeds"] == [seed, seed]
    assert len(list((tmp_path / "results").iterdir())) == 3


def test_a_policy_named_twice_is_one_and_two_of_one_name_get_two_files(own, tmp_path):
    (tmp_path / "b").mkdir()
    other = shutil.copy(own, tmp_path / "b")
    run = ["--env", BOAT, "--program", "none", "none", "--steps", 5]
    run += ["--policy", f"{own}:act", f"{own}:act", f"{other}:act"]
    found = evaluated(tmp_path / "out", *run)
    assert len(found["episodes"]) == len(found["aggregate"]) == 2
    assert len(list((tmp_path / "out").glob("episode-*.png"))) == 2
