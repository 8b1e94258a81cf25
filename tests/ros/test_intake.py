"""Goals until guidance leads to them: whatever comes meanwhile, the last one leads."""

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from needs import needs

from hcbf_gym.errors import InvalidInputError
from hcbf_robots.ros import messages
from hcbf_robots.ros.worker import Worker

GOAL, OTHER = (3.0, 0.0), (0.0, 2.0)


class Core:
    """What an intake needs of a node's core; `planned` waits until it is let go."""

    def __init__(self):
        zone = SimpleNamespace(name="zone", type="circle", topic="zone", filter_info_topic="")
        self.settings = SimpleNamespace(
            sources=[zone], guidance="geodesic", goal_topic="goal", global_frame_id="odom"
        )
        self.sources = {"zone": SimpleNamespace(settings=None, is_scan=False)}
        self.localization, self.unreachable = SimpleNamespace(newest=0), ()
        self.go_on, self.begun = threading.Event(), threading.Semaphore(0)
        self.plans, self.waits, self.heard, self.leads = [], [], 0, []
        self.go_on.set()

    def planned(self, goal):
        if goal is None:
            return None
        self.plans.append((tuple(goal), self.heard))
        self.begun.release()
        assert self.go_on.wait(10.0)
        if tuple(goal) in self.unreachable:
            raise InvalidInputError("goal: there is no way")
        return tuple(goal)

    def take(self, planned):
        self.leads.append(planned)

    def wait(self, goal):
        self.waits.append(tuple(goal))

    def hear_source(self, *_):
        self.heard += 1
        return True

    def refuse_source(self, *error):
        raise AssertionError(error)


@pytest.fixture
def hearing(monkeypatch):
    from hcbf_robots.ros import sources
    from hcbf_robots.ros.intake import Intake

    monkeypatch.setattr(sources, "of_circle", lambda *_: ())
    core, heard = Core(), {}
    intake = Intake(
        core,
        threading.Lock(),
        lambda: SimpleNamespace(ros=0.0, steady=0.0),
        lambda kind, topic, callback, quality: heard.update({topic: callback}),
        None,
        SimpleNamespace(warning=lambda *_, **__: None),
    )
    yield core, lambda goal: heard["goal"](goal_message(goal)), lambda: heard["zone"](circle())
    core.go_on.set()
    intake.close()


def goal_message(goal):
    from geometry_msgs.msg import PoseStamped

    message = PoseStamped()
    message.header.frame_id = "odom"
    message.pose.position.x, message.pose.position.y = goal
    return message


def circle():
    from geometry_msgs.msg import PointStamped

    message = PointStamped()
    message.header.frame_id = "odom"
    return message


def soon(holds):
    """Wait until something holds; the threads are the intake's own."""
    end = time.monotonic() + 10.0
    while not holds() and time.monotonic() < end:
        time.sleep(0.002)
    assert holds()


@needs("rclpy")
def test_what_comes_while_a_field_is_computed_has_it_computed_again(hearing):
    core, ask, hear = hearing
    core.go_on.clear()
    ask(GOAL)
    assert core.begun.acquire(timeout=10.0)
    hear()
    soon(lambda: core.heard == 1)
    core.go_on.set()
    soon(lambda: len(core.leads) == 2)
    assert core.plans == [(GOAL, 0), (GOAL, 1)]


@needs("rclpy")
def test_a_goal_that_is_repeated_is_computed_once_and_one_before_the_first_pose_waits(hearing):
    core, ask, _ = hearing
    core.localization.newest = None
    ask(GOAL)
    soon(lambda: core.waits == [GOAL])
    core.localization.newest = 0
    ask(OTHER)
    soon(lambda: core.leads == [OTHER])
    ask(OTHER)
    ask(GOAL)
    soon(lambda: core.leads == [OTHER, GOAL])
    assert [goal for goal, _ in core.plans] == [OTHER, GOAL]


@needs("rclpy")
def test_a_goal_that_cannot_be_reached_ends_guidance_and_forgets_no_newer_one(hearing):
    core, ask, hear = hearing
    core.unreachable = (GOAL,)
    core.go_on.clear()
    ask(GOAL)
    assert core.begun.acquire(timeout=10.0)
    ask(OTHER)
    core.go_on.set()
    soon(lambda: core.leads == [None, OTHER])
    hear()
    soon(lambda: core.leads == [None, OTHER, OTHER])
    ask(GOAL)
    soon(lambda: core.leads[-1] is None)
    hear()
    soon(lambda: core.heard == 2)
    time.sleep(0.05)
    assert core.plans[-1][0] == GOAL  # it is not repeated
    assert core.leads[-1] is None


@needs("rclpy")
def test_the_rigs_robot_publishes_a_valid_scan():
    from benchmarks.ros import rig

    for far in (3.0, math.inf):
        beams = messages.beams_of(rig.scan_of(np.full(60, far)))
        assert beams.ranges.tolist() == [far] * 60


def test_a_newer_job_replaces_one_of_its_name_that_waits():
    begun, goes, done, failed = threading.Event(), threading.Event(), [], []
    worker = Worker(lambda *what: failed.append(what))
    worker.put("first", lambda: (begun.set(), goes.wait()))
    begun.wait()
    ended = threading.Event()
    worker.put("map", lambda: done.append("old map"))
    worker.put("scan", lambda: done.append("scan"))
    worker.put("map", lambda: done.append("map"))
    worker.put("end", ended.set)
    goes.set()
    assert ended.wait(5.0)
    worker.close()
    assert sorted(done) == ["map", "scan"]
    assert not failed


def test_an_exception_of_a_job_is_reported_and_the_next_one_runs():
    failed, ended = [], threading.Event()
    worker = Worker(lambda name, error: failed.append((name, str(error))))
    worker.put("map", lambda: 1 / 0)
    worker.put("end", ended.set)
    assert ended.wait(5.0)
    worker.close()
    assert failed == [("map", "division by zero")]
