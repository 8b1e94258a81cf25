import json
import threading
import time

import numpy as np
import pytest

from hcbf_gym import HcbfError, scenarios
from hcbf_gym.barriers import Disc, HalfPlane, SpeedLimit
from hcbf_gym.models import Reason
from hcbf_gym.scenarios.references import PointReference
from hcbf_lab.play import editing
from hcbf_lab.play.drawing import stacked
from hcbf_lab.play.report import sentence
from hcbf_lab.play.session import Session
from hcbf_lab.play.settings import Settings

GATE = scenarios.Scenario(
    "gate",
    (
        Disc("strict", 1, center=(2.0, 0.0), radius=0.5),
        Disc("soft", 2, center=(0.0, 2.0), radius=0.5),
        HalfPlane("wall", 1, normal=(0.0, 1.0), offset=-3.0),
    ),
    PointReference((4.0, 0.0)),
)


@pytest.fixture
def session():
    return Session(Settings(model="reduced"), GATE)


def ticks(session, count):
    for _ in range(count):
        session.tick()
    return session.latest


def do(session, command, *arguments, **named):
    session.post(getattr(session, command), *arguments, **named)
    return ticks(session, 1)


def test_a_person_who_steers_into_rank_1_for_ten_seconds_stays_out_of_it(session):
    do(session, "change", policy="human")
    do(session, "steer", (1.0, 0.0))
    walk = [ticks(session, 1) for _ in range(500)]
    assert max(now.position[0] for now in walk) > 1.2  # it did walk up to the region
    assert walk[-1].least[1] >= 0.0
    assert {"NOMINAL", "SAFE"} <= {now.status for now in walk}
    assert max(now.intervention for now in walk) > 0.1


def test_without_a_filter_the_same_stick_leads_into_it(session):
    do(session, "change", policy="human", program="none")
    do(session, "steer", (1.0, 0.0))
    now = ticks(session, 500)
    assert now.least[1] < -0.4
    assert (now.status, now.slack) == ("UNFILTERED", {1: 0.0, 2: 0.0})


@pytest.mark.parametrize("guidance", [False, True])
def test_a_dragged_stick_leads_to_its_point_without_guidance_and_stops_when_let_go(
    session, guidance
):
    do(session, "change", policy="human", guidance=guidance)
    do(session, "lead_to", (-1.0, -1.0))
    assert np.allclose(ticks(session, 400).position, (-1.0, -1.0), atol=0.05)
    do(session, "lead_to", None)
    assert np.linalg.norm(ticks(session, 100).velocity) < 0.02


def test_regions_move_change_size_and_rank_while_the_robot_walks(session):
    before = ticks(session, 50)
    do(session, "move", "strict", (3.0, 0.1))
    do(session, "resize", "strict", 0.8)
    now = do(session, "rank", "soft", 1)
    moved = editing.region(now.scenario, "strict")
    assert (moved.center, moved.radius, set(now.h)) == ((3.0, 0.1), 0.8, {1})
    assert before.time < now.time < before.time + 0.1
    expected = min(np.hypot(*(now.position - (3.0, 0.1))) - 0.8, now.position[1] + 3.0)
    assert now.h[1] == pytest.approx(expected)


def test_a_scene_with_nothing_to_move_runs_too(session):
    limit = SpeedLimit("limit", 1, v_max=0.5)
    do(session, "choose_scene", scenarios.Scenario("open", (limit,), GATE.reference))
    now = ticks(session, 100)
    assert (editing.names(now.scenario), now.h) == ([], {})
    assert np.linalg.norm(now.velocity) <= 0.5


def test_an_edit_ends_at_the_region_as_it_moves_itself():
    moving = Disc("a", 1, center=(3.0, 0.0), radius=0.5, velocity=(0.5, 0.0))
    scene = scenarios.Scenario("moving", (moving,), PointReference((6.0, 0.0)))
    edited = editing.move(scene, "a", (1.0, 1.0), t=4.0)
    assert np.allclose(editing.position(edited.barriers[0], 4.0), (1.0, 1.0))


@pytest.mark.parametrize("name", ["random-clutter", "paper-simulation"])
def test_every_region_of_a_scene_keeps_its_shape_when_it_is_moved_and_resized(name):
    scene = scenarios.make(name)
    for barrier in scene.barriers:
        moved = editing.region(editing.move(scene, barrier.name, (1.0, -2.0)), barrier.name)
        if isinstance(barrier, HalfPlane):
            assert np.array(barrier.normal) @ (1.0, -2.0) == pytest.approx(moved.offset)
            continue
        assert np.allclose(editing.position(moved), (1.0, -2.0))
        assert editing.size(moved) == pytest.approx(editing.size(barrier))
        bigger = editing.region(editing.resize(scene, barrier.name, 1.7), barrier.name)
        assert editing.size(bigger) == pytest.approx(1.7)
        assert np.allclose(editing.position(bigger), editing.position(barrier))


@pytest.mark.parametrize(
    ("command", "arguments", "message"),
    [
        ("resize", ("strict", 0.0), "expected a number > 0"),
        ("resize", ("wall", 1.0), "got a wall"),
        ("rank", ("strict", 0), "expected >= 1"),
        ("move", ("nowhere", (0.0, 0.0)), "unknown region"),
        ("move", ("strict", (np.nan, 0.0)), "expected finite numbers"),
        ("choose_scene", ("no-such-scene",), "unknown scenario"),
        ("load_scene", (b"{broken",), "is no JSON"),
        ("load_scene", (b"\xff\xfe\x00",), "is no JSON"),
        ("load_scene", (b"[" * 100_000,), "is no JSON"),
        ("load_scene", (b'{"name": "x"}',), "missing field"),
        ("push", ((50.0, 0.0),), "has a body"),
        ("set_pace", (0.0,), "expected a number > 0"),
    ],
)
def test_a_refusal_is_reported_until_the_next_command_and_changes_nothing(
    session, command, arguments, message
):
    before = ticks(session, 20)
    now = do(session, command, *arguments)
    assert message in now.message
    assert now.messages == before.messages + 1
    assert now.scenario == before.scenario
    assert now.time == pytest.approx(before.time + 0.02)
    assert not do(session, "resize", "strict", 0.4).message


def test_a_policy_for_other_scenes_is_refused_with_its_reason(session):
    now = do(session, "change", policy="ppo")
    assert "for which it was trained" in now.message
    assert now.settings.policy == "pd"


def test_a_region_on_the_goal_of_a_guided_robot_is_refused_and_the_path_stays(session):
    do(session, "change", guidance=True, returns=False)
    now = do(session, "move", "strict", (4.0, 0.0))
    assert "goal" in now.message
    assert now.scenario == GATE
    assert ticks(session, 1000).position[0] == pytest.approx(4.0, abs=0.3)


def test_a_scene_survives_a_file(session):
    do(session, "move", "strict", (1.5, 0.3))
    content = editing.to_json(session.latest.scenario)
    assert json.loads(content)["name"] == "gate"
    kept = session.latest.scenario.to_dict()
    do(session, "choose_scene", "paper-simulation")
    now = do(session, "load_scene", content)
    assert now.scenario.to_dict() == kept
    assert now.time == pytest.approx(0.02)


def test_a_pause_stops_time_and_a_step_takes_one(session):
    do(session, "pause", True)
    still = session.latest.time
    assert ticks(session, 5).time == still
    do(session, "step_once")
    assert ticks(session, 5).time == pytest.approx(still + 0.02)


def test_a_seed_draws_a_random_scene_and_a_restart_keeps_it():
    session = Session(Settings(model="reduced", seed=3), "random")
    first = session.latest.scenario.barriers
    ticks(session, 50)
    assert do(session, "restart").scenario.barriers == first
    assert do(session, "change", seed=4).scenario.barriers != first
    assert do(session, "change", seed=3).scenario.barriers == first


def test_a_robot_goes_to_another_goal_and_keeps_its_own_where_no_path_leads(session):
    do(session, "change", returns=False)
    ticks(session, 49)
    now = do(session, "go_to", (0.5, -2.0))
    assert now.time == pytest.approx(1.02)
    assert "0.50, -2.00" in now.message
    assert np.allclose(ticks(session, 1500).position, (0.5, -2.0), atol=0.3)
    now = do(session, "go_to", (2.0, 0.0))  # inside the strict region
    assert "goal" in now.message
    assert np.allclose(now.scenario.goal, (0.5, -2.0))
    do(session, "choose_scene", "paper-simulation")
    assert "course" in do(session, "go_to", (0.0, 1.0)).message


def test_time_passes_while_a_browser_watches_and_the_first_sees_a_robot_under_way(session):
    do(session, "attend", False)
    do(session, "change", returns=False)
    assert ticks(session, 5).time == pytest.approx(0.0)
    do(session, "attend", True)
    under_way = ticks(session, 50).time
    assert under_way > 0.9
    do(session, "attend", False)
    assert do(session, "attend", True).time == pytest.approx(under_way + 0.02)
    assert np.allclose(ticks(session, 2000).position, GATE.goal, atol=0.3)
    do(session, "attend", False)
    assert do(session, "attend", True).time == pytest.approx(0.02)


def test_regions_that_overlap_have_different_heights_a_higher_rank_above():
    placed = stacked(scenarios.make("random-clutter"))
    assert min(np.diff([height for _, height in placed])) > 5e-4
    ranks = [region.priority for region, _ in placed]
    assert ranks == sorted(ranks, reverse=True)


def test_a_robot_that_arrives_reports_it_and_returns(session):
    messages = [""]
    for _ in range(3000):
        if (message := ticks(session, 1).message) != messages[-1]:
            messages.append(message)
        if "to the goal again" in message:
            break
    assert messages[1].startswith("Arrived after ")
    assert messages[2] == "Arrived; now back to the start."
    assert messages[-1] == "Arrived; now to the goal again."
    assert np.allclose(session.latest.position, GATE.start, atol=0.3)
    do(session, "restart")
    assert np.allclose(session.latest.scenario.goal, GATE.goal)


def test_a_course_begins_anew_when_it_has_ended(session):
    do(session, "choose_scene", "paper-simulation")
    assert ticks(session, 1000).time > ticks(session, 300).time


def test_the_first_key_takes_the_controls(session):
    assert session.latest.settings.policy == "pd"
    assert do(session, "steer", (0.0, 0.0)).settings.policy == "pd"
    now = do(session, "steer", (0.0, 0.5))
    assert now.settings.policy == "human"
    assert "You steer" in now.message
    assert ticks(session, 50).velocity[1] == pytest.approx(0.5, abs=0.1)


def test_a_policy_of_ones_own_drives(session, tmp_path):
    (tmp_path / "own.py").write_text("def act(o, i):\n    return [1.0, 0.0]\n", encoding="utf-8")
    now = do(session, "change", policy=f"{tmp_path / 'own.py'}:act")
    assert now.settings.policy.endswith("own.py:act")
    assert ticks(session, 30).position[0] > now.position[0]


@pytest.mark.physics
@pytest.mark.parametrize("robot", ["cart", "holonomic-cart"])
def test_a_cart_is_steered_as_the_stick_points(robot):
    session = Session(Settings(model=robot, policy="human"), GATE)
    do(session, "steer", (-0.3, 0.4))
    now = ticks(session, 200)
    assert now.body is not None
    np.testing.assert_allclose(now.velocity, (-0.3, 0.4), atol=0.12)
    assert now.least[1] >= 0.0


@pytest.mark.parametrize(
    "given", [{"gamma0": float("nan")}, {"body": "x"}, {"seed": -1}, {"margin": True}]
)
def test_settings_made_in_python_are_checked_as_a_commands(given):
    with pytest.raises(HcbfError, match=next(iter(given))):
        Settings(**given)


def test_a_robot_of_an_unknown_name_is_refused_with_the_choices():
    with pytest.raises(HcbfError, match=r"cart.*reduced"):
        Session(Settings(model="submarine"), GATE)


def test_readings_are_in_words(session):
    details = ticks(session, 5).details
    assert details["margin"].endswith("derived")
    assert details["reachable"] == "enters nothing"


def test_the_clock_sets_the_pace_and_commands_come_from_any_thread(session):
    stop = threading.Event()
    thread = threading.Thread(target=session.run, args=(stop,), daemon=True)
    session.tick()
    session.post(session.set_pace, 0.5)
    thread.start()
    time.sleep(1.0)
    slow = session.latest.time
    stop.set()
    thread.join(5.0)
    assert not thread.is_alive()
    assert 0.1 < slow < 0.75


def test_a_sentence_explains_why_the_filter_brakes():
    found = sentence("BACKUP", {}, {1: 0.3}, 0.5, Reason.STATE)
    assert found.startswith("The filter brakes: the state is not finite, ")
    assert "restart" in sentence("BACKUP", {}, {1: 0.3}, 0.5, Reason.LAG)


@pytest.mark.parametrize(
    ("status", "slack", "expected"),
    [
        ("NOMINAL", {}, "The policy decides: no region is near enough to matter."),
        ("SAFE", {1: 0.0}, "Every rank holds: the filter changes the input by 0.5 m/s²."),
        ("RELAXED", {1: 0.0, 3: 0.42}, "Rank 3 pays 0.4 m/s² so that ranks 1 and 2 hold."),
        ("RELAXED", {2: 0.1, 3: 0.42}, "Ranks 2 and 3 pay 0.4 m/s² so that rank 1 holds."),
        ("VIOLATED", {1: 2.0}, "No input satisfies rank 1: it lacks 2.0 m/s²."),
        ("UNFILTERED", {}, "There is no filter, and nothing is hit."),
    ],
)
def test_a_sentence_names_who_pays_for_whom(status, slack, expected):
    assert sentence(status, slack, {1: 0.3, 2: 0.2, 3: 0.1}, 0.5) == expected
