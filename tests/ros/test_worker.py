"""The thread that prepares: the newest job of each name, and its exceptions are reported."""

import threading

from hcbf_robots.ros.worker import Worker


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
