import functools
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import crashing
import joblib
import pytest
from needs import needs

from hcbf_gym import sources
from hcbf_gym.errors import ChunkError, InvalidInputError, UnknownNameError
from hcbf_gym.evaluation import chunks

PATH = os.pathsep.join(
    filter(None, [os.environ.get("PYTHONPATH"), str(Path(crashing.__file__).parent)])
)
"""Where a process finds this package and the crashing jobs."""


def over(function, jobs, folder=None, workers=None, backend="processes", **options):
    return chunks.Runs(folder, workers, backend).over(function, jobs, **options)


def ran(folder):
    """Return how often each job ran."""
    return {int(file.stem): len(file.read_text()) for file in Path(folder).glob("*.ran")}


def test_results_are_the_same_bit_for_bit_whoever_runs_them_and_read_again(tmp_path):
    jobs = [0.1 * k for k in range(7)]
    expected = {k: crashing.third(job) for k, job in enumerate(jobs)}
    run = functools.partial(over, crashing.third, jobs, size=2)
    assert dict(run(workers=1)) == expected
    assert dict(run(workers=2, folder=tmp_path)) == expected
    assert dict(run(workers=1, folder=tmp_path)) == expected


def test_a_finished_chunk_does_not_run_again_and_a_new_job_does(tmp_path):
    jobs = [(str(tmp_path), k) for k in range(5)]
    folder = tmp_path / "chunks"
    run = functools.partial(over, crashing.logged, folder=folder, workers=1, size=2)
    for number, _ in run(jobs[:4]):
        if number == 1:
            break
    assert ran(tmp_path) == {0: 1, 1: 1}
    assert dict(run(jobs)) == {k: k / 3.0 for k in range(5)}
    assert ran(tmp_path) == dict.fromkeys(range(5), 1)


def test_other_work_in_the_folder_is_not_mistaken_for_this(tmp_path):
    first = functools.partial(round, ndigits=0)
    second = functools.partial(round, ndigits=1)
    assert dict(over(first, [1.26], folder=tmp_path, workers=1)) == {0: 1.0}
    assert dict(over(second, [1.26], folder=tmp_path, workers=1)) == {0: 1.3}
    assert dict(over(abs, [1.26], folder=tmp_path, workers=1)) == {0: 1.26}


@pytest.mark.parametrize(
    ("line", "package"),
    [
        ("from physics import gain", False),
        ("import math, physics", False),
        ("from .physics import gain", True),
        ("from . import physics", True),
    ],
)
def test_an_edit_of_what_a_users_file_imports_is_other_work(line, package, tmp_path, monkeypatch):
    folder = tmp_path / "mine"
    folder.mkdir()
    if package:
        (folder / "__init__.py").write_text("")
    (folder / "plant.py").write_text(line + "\n")
    (folder / "physics.py").write_text("gain = 1.0\n")
    before = chunks.sources_of(abs, [folder / "plant.py"])
    (folder / "physics.py").write_text("gain = 2.0\n")
    monkeypatch.setattr(sources, "_digest", sources._digest.__wrapped__)  # another process
    assert chunks.sources_of(abs, [folder / "plant.py"]) != before


def test_what_a_dead_worker_had_runs_again_and_nothing_that_was_finished(tmp_path):
    jobs = [(str(tmp_path), k) for k in range(4)]
    results = dict(over(crashing.dies_once, jobs, folder=tmp_path / "chunks", workers=2))
    assert results == {k: k / 3.0 for k in range(4)}
    assert ran(tmp_path) == dict.fromkeys(range(4), 1)


def test_a_chunk_that_kills_its_workers_is_named_and_the_others_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, "ATTEMPTS", 2)
    with pytest.raises(ChunkError, match=r"from job 1, 1: its worker died 2 times") as raised:
        dict(over(crashing.dies, [0, 1, 2, 3], folder=tmp_path, workers=2))
    assert "\n" not in str(raised.value)
    assert len(list(tmp_path.glob("*.chunk"))) == 3


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_function_is_one_line_and_one_of_ours_stays_as_it_is(tmp_path, workers):
    with pytest.raises(ChunkError, match=r"from job 2, 2: got KeyError: 'one") as raised:
        dict(over(crashing.raises, [0, 1, 2, 3], folder=tmp_path, workers=workers))
    assert "\n" not in str(raised.value)
    assert len(list(tmp_path.glob("*.chunk"))) >= 2
    with pytest.raises(InvalidInputError, match=r"^job: got one, expected none$"):
        dict(over(crashing.refuses, [0], workers=workers))


def test_who_stops_iterating_stops_the_workers():
    begun = time.monotonic()
    for number, _ in over(crashing.sleeps, [0, 3, 1, 4], workers=2):
        assert number == 0
        break
    assert time.monotonic() - begun < 60.0


SCRIPT = """
    import signal, sys
    from pathlib import Path
    import crashing
    from hcbf_gym.evaluation import chunks
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
    for number, _ in chunks.Runs(Path(sys.argv[1]), 2).over(crashing.sleeps, [0, 1, 2, 3]):
        print(number, flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_or_killed_run_keeps_what_is_finished_and_leaves_no_process(tmp_path, how):
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(SCRIPT), str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": PATH},
    ) as process:
        assert process.stdout is not None
        for _ in range(3):
            process.stdout.readline()
        process.send_signal(how)
        process.stdout.read()  # ends when the last process has, which holds the other end
    assert len(list(tmp_path.glob("*.chunk"))) == 3


ON_RAY = """
    import json, sys
    from pathlib import Path
    import crashing
    from hcbf_gym.errors import ChunkError, InvalidInputError
    from hcbf_gym.evaluation import chunks
    folder = Path(sys.argv[1])
    refused = []
    for function, workers in ((crashing.third, 10_000), (crashing.raises, None)):
        try:
            dict(chunks.Runs(None, workers, "ray").over(function, [1, 2]))
        except (ChunkError, InvalidInputError) as error:
            refused.append(str(error))
    jobs = [(str(folder), k) for k in range(4)]
    results = dict(chunks.Runs(folder / "chunks", None, "ray").over(crashing.dies_once, jobs))
    print(json.dumps([refused, sorted(results.items())]))
"""


@needs("ray")
def test_a_ray_cluster_gives_the_same_loses_nothing_and_refuses_in_a_sentence(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ON_RAY), str(tmp_path)],
        env=os.environ | {"PYTHONPATH": PATH},
        capture_output=True,
        text=True,
        check=True,
    )
    refused, results = json.loads(done.stdout.splitlines()[-1])
    assert results == [[k, k / 3.0] for k in range(4)]
    assert ran(tmp_path) == dict.fromkeys(range(4), 1)
    assert "got 10000, expected at most the" in refused[0]
    assert "from job 1, 2: got KeyError: 'one" in refused[1]
    assert not any("\n" in text for text in refused)


def test_a_file_that_is_no_chunk_is_refused_in_words(tmp_path):
    dict(over(abs, [1.0], folder=tmp_path, workers=1))
    (file,) = tmp_path.glob("*.chunk")
    file.write_bytes(b"half of it")
    with pytest.raises(InvalidInputError, match="delete it to run it again"):
        dict(over(abs, [1.0], folder=tmp_path, workers=1))


def test_a_chunk_counts_only_while_the_files_that_its_jobs_opened_are_the_same(tmp_path):
    lag = tmp_path / "lag"
    lag.write_text("0.5")
    jobs = [(str(lag), k) for k in range(4)]
    run = functools.partial(
        over, crashing.lagged, jobs, folder=tmp_path / "chunks", workers=1, size=2
    )
    assert dict(run()) == {k: k + 0.5 for k in range(4)}
    lag.write_text("1.0")
    assert dict(run()) == {k: k + 1.0 for k in range(4)}
    missing = tmp_path / "bonus"
    missing.write_text("10.0")  # was looked for and not there
    assert dict(run()) == {k: k + 11.0 for k in range(4)}
    link = tmp_path / "link"
    link.symlink_to(lag)
    jobs = [(str(link), 0)]
    run = functools.partial(over, crashing.lagged, jobs, folder=tmp_path / "chunks", workers=1)
    assert dict(run()) == {0: 11.0}
    (tmp_path / "other").write_text("2.0")
    link.unlink()
    link.symlink_to(tmp_path / "other")
    assert dict(run()) == {0: 12.0}


@pytest.mark.parametrize("workers", [1, 2])
def test_a_file_that_changes_while_jobs_read_it_ends_the_run(tmp_path, workers):
    lag = tmp_path / "lag"
    lag.write_text("0.5")
    with pytest.raises(InvalidInputError, match=r"lag changed after it was read"):
        dict(over(crashing.changes_it, [str(lag)], folder=tmp_path / "c", workers=workers))
    assert not list(tmp_path.glob("c/*.chunk"))


def test_what_jobs_write_themselves_decides_nothing(tmp_path):
    jobs = [(str(tmp_path / "cache"), k) for k in range(3)]
    folder = tmp_path / "chunks"
    run = functools.partial(over, crashing.cached, jobs, folder=folder, workers=1, size=3)
    first = dict(run())
    (tmp_path / "cache").write_text("99.0")
    assert dict(run()) == first


def test_one_job_of_every_kept_chunk_is_repeated_and_compared_where_that_is_asked(tmp_path):
    jobs = [float(k) for k in range(6)]
    run = functools.partial(
        over, crashing.third, jobs, folder=tmp_path, workers=1, size=2, repeat=True
    )
    right = dict(run())
    assert dict(run()) == right
    file = sorted(tmp_path.glob("*.chunk"))[1]
    results, read = joblib.load(file)
    joblib.dump(([one | {"third": one["third"] + 1e-12} for one in results], read), file)
    with pytest.warns(UserWarning, match="than it gives now: the chunk runs again") as raised:
        assert dict(run()) == right
    assert len(raised) == 1
    assert dict(run()) == right


def test_of_every_kept_chunk_one_job_runs_again_and_no_more(tmp_path):
    jobs = [(str(tmp_path), k) for k in range(6)]
    run = functools.partial(
        over, crashing.logged, jobs, folder=tmp_path / "chunks", size=3, repeat=True
    )
    first = dict(run(workers=1))
    before = ran(tmp_path)
    assert dict(run(workers=2)) == first
    assert sorted(ran(tmp_path)[k] - before[k] for k in before) == [0, 0, 0, 0, 1, 1]


def test_another_plant_is_other_work(tmp_path):
    def run(plant):
        return over(
            crashing.logged, [(str(tmp_path), 1)], folder=tmp_path / "c", plant=plant, workers=1
        )

    for name, times in (("a", 1), ("a", 1), ("b", 2)):
        dict(run(name))
        assert ran(tmp_path) == {1: times}


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"size": 0}, InvalidInputError),
        ({"workers": 0}, InvalidInputError),
        ({"backend": "cloud"}, UnknownNameError),
    ],
)
def test_bad_arguments_are_refused_before_anything_runs(options, error):
    with pytest.raises(error):
        over(abs, [1.0], **options)


def test_what_cannot_be_pickled_is_refused_where_it_is_to_be_saved(tmp_path):
    with pytest.raises(InvalidInputError, match="can be pickled"):
        over(lambda job: job, [1.0], folder=tmp_path)


def test_a_notebook_without_widgets_gets_no_bar_and_no_warning_of_it(monkeypatch, recwarn):
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert list(over(abs, range(3), workers=1, size=1, title="numbers"))
    assert not recwarn


def test_where_no_terminal_shows_the_bar_lines_say_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(chunks, "SAID_EVERY", 0.0)
    list(over(abs, range(3), workers=1, size=1, title="numbers"))
    said = capsys.readouterr().err
    assert [f"numbers: {k} of 3" in said for k in (1, 2, 3)] == [True] * 3
