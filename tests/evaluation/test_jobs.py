"""Jobs: the same results wherever they run, no finished one lost, no other work mistaken for it."""

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

from hcbf_gym.errors import InvalidInputError, JobError, UnknownNameError
from hcbf_gym.evaluation import jobs
from hcbf_gym.evaluation import workers as backends
from hcbf_gym.evaluation.jobs import Runs

PATH = os.pathsep.join(
    filter(None, [os.environ.get("PYTHONPATH"), str(Path(crashing.__file__).parent)])
)
"""Where a process finds this package and the crashing jobs."""
THIRDS = {k: k / 3.0 for k in range(4)}


def over(function, listed, folder=None, workers=1, backend="processes", **options):
    return dict(Runs(folder, workers, backend).over(function, listed, **options))


def ran(folder):
    """Return how often each job ran."""
    return {int(file.stem): len(file.read_text()) for file in Path(folder).glob("*.ran")}


def test_results_are_the_same_bit_for_bit_in_any_process_and_read_again(tmp_path):
    listed = [0.1 * k for k in range(7)]
    expected = {k: crashing.third(job) for k, job in enumerate(listed)}
    run = functools.partial(over, crashing.third, listed)
    assert run() == run(workers=2, folder=tmp_path) == run(folder=tmp_path) == expected


def test_a_finished_job_does_not_run_again_and_a_new_job_does(tmp_path):
    listed = [(str(tmp_path), k) for k in range(4)]
    for number, _ in Runs(tmp_path / "saved", 1).over(crashing.logged, listed[:3]):
        if number == 1:
            break
    assert ran(tmp_path) == {0: 1, 1: 1}
    assert over(crashing.logged, listed, tmp_path / "saved") == THIRDS
    assert ran(tmp_path) == dict.fromkeys(range(4), 1)


def test_other_work_in_the_folder_is_not_mistaken_for_this(tmp_path):
    rounded = [functools.partial(round, ndigits=k) for k in (0, 1)]
    for function, expected in zip([*rounded, abs], (1.0, 1.3, 1.26), strict=True):
        assert over(function, [1.26], tmp_path) == {0: expected}
    for plant, times in (("a", 1), ("a", 1), ("b", 2)):
        over(crashing.logged, [(str(tmp_path), 1)], tmp_path / "saved", plant=plant)
        assert ran(tmp_path) == {1: times}


@pytest.mark.parametrize(
    ("line", "package"),
    [
        ("from physics import gain", False),
        ("import math, physics", False),
        ("from .physics import gain", True),
    ],
)
def test_an_edit_of_what_a_users_file_imports_is_other_work(line, package, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    if package:
        (folder / "__init__.py").write_text("")
    (folder / "plant.py").write_text(line + "\n")
    (folder / "physics.py").write_text("gain = 1.0\n")
    (folder / "notes.txt").write_text("unrelated")

    def found():
        return jobs.sources_of(abs, jobs.of_user(folder / "plant.py"))

    before = found()
    (folder / "notes.txt").write_text("edited")
    assert found() == before
    (folder / "physics.py").write_text("gain = 2.0\n")
    assert found() != before


def test_a_job_whose_worker_died_runs_again_and_no_finished_one(tmp_path):
    listed = [(str(tmp_path), k) for k in range(4)]
    assert over(crashing.dies_once, listed, tmp_path / "saved", workers=2) == THIRDS
    assert ran(tmp_path) == dict.fromkeys(range(4), 1)


def test_a_job_that_kills_its_workers_is_named_and_the_others_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "ATTEMPTS", 2)
    with pytest.raises(JobError, match=r"^job 1, 1: its worker died 2 times.*[^\n]*$"):
        over(crashing.dies, [0, 1, 2, 3], tmp_path, workers=2)
    assert len(list(tmp_path.glob("*.job"))) == 3


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_function_is_one_line_and_one_of_ours_stays_as_it_is(tmp_path, workers):
    with pytest.raises(JobError, match=r"job 2, 2: got KeyError: 'one") as raised:
        over(crashing.raises, [0, 1, 2, 3], tmp_path, workers)
    assert "\n" not in str(raised.value)
    assert len(list(tmp_path.glob("*.job"))) >= 2
    with pytest.raises(InvalidInputError, match=r"^job: got one, expected none$"):
        over(crashing.refuses, [0], workers=workers)


def test_an_end_of_the_iteration_stops_the_workers():
    begun = time.monotonic()
    assert next(Runs(workers=2).over(crashing.sleeps, [0, 3, 1, 4]))[0] == 0
    assert time.monotonic() - begun < 60.0


SCRIPT = """
    import signal, sys
    from pathlib import Path
    import crashing
    from hcbf_gym.evaluation.jobs import Runs
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
    for number, _ in Runs(Path(sys.argv[1]), 2).over(crashing.sleeps, [0, 1, 2, 3]):
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
    assert len(list(tmp_path.glob("*.job"))) == 3


ON_RAY = """
    import json, sys
    from pathlib import Path
    import crashing
    from hcbf_gym.errors import InvalidInputError, JobError
    from hcbf_gym.evaluation.jobs import Runs
    folder = Path(sys.argv[1])
    refused = []
    for function, workers in ((crashing.third, 10_000), (crashing.raises, None)):
        try:
            dict(Runs(None, workers, "ray").over(function, [1, 2]))
        except (JobError, InvalidInputError) as error:
            refused.append(str(error))
    jobs = [(str(folder), k) for k in range(4)]
    results = dict(Runs(folder / "saved", None, "ray").over(crashing.dies_once, jobs))
    answer = json.dumps([refused, sorted(results.items())])
    (folder / "answer").write_text(answer)  # Ray prints to the standard output, too
"""


@needs("ray")
def test_a_ray_cluster_gives_the_same_loses_nothing_and_refuses_in_a_sentence(tmp_path):
    subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ON_RAY), str(tmp_path)],
        env=os.environ | {"PYTHONPATH": PATH},
        capture_output=True,
        check=True,
    )
    refused, results = json.loads((tmp_path / "answer").read_text())
    assert dict(results) == THIRDS
    assert ran(tmp_path) == dict.fromkeys(range(4), 1)
    assert "got 10000, expected at most the" in refused[0]
    assert "job 1, 2: got KeyError: 'one" in refused[1]
    assert not any("\n" in text for text in refused)


def test_a_damaged_result_is_refused_in_words(tmp_path):
    """Wherever it is cut or changed; a cut of the checksum at the end leaves the result whole."""
    expected = over(abs, [1.0], tmp_path)
    (file,) = tmp_path.glob("*.job")
    whole, checksum = file.read_bytes(), 4
    cut = [whole[:k] for k in range(len(whole) - checksum)]
    changed = [whole[:k] + bytes([byte ^ 0x55]) + whole[k + 1 :] for k, byte in enumerate(whole)]
    for damaged in (b"half of it", *cut, *changed):
        file.write_bytes(damaged)
        with pytest.raises(InvalidInputError, match="delete it to run its job again"):
            over(abs, [1.0], tmp_path)
    file.unlink()
    assert over(abs, [1.0], tmp_path) == expected


def test_idle_workers_wait_for_the_next_jobs(monkeypatch):
    """joblib's limit of 300 s may pass as these are given, which makes it warn."""
    given = {}
    monkeypatch.setattr(joblib, "Parallel", lambda workers, **options: given.update(options))
    backends.parallel("processes", 2)
    assert given["idle_worker_timeout"] >= 3600.0


def test_a_result_counts_only_while_the_files_that_its_job_opened_are_the_same(tmp_path):
    lag = tmp_path / "lag"
    lag.write_text("0.5")
    run = functools.partial(
        over, crashing.lagged, [(str(lag), k) for k in range(2)], tmp_path / "saved"
    )
    assert run() == {0: 0.5, 1: 1.5}
    lag.write_text("1.0")
    assert run() == {0: 1.0, 1: 2.0}
    (tmp_path / "bonus").write_text("10.0")  # was looked for and not there
    assert run() == {0: 11.0, 1: 12.0}
    link = tmp_path / "link"
    link.symlink_to(lag)
    run = functools.partial(over, crashing.lagged, [(str(link), 0)], tmp_path / "saved")
    assert run() == {0: 11.0}
    (tmp_path / "other").write_text("2.0")
    link.unlink()
    link.symlink_to(tmp_path / "other")
    assert run() == {0: 12.0}


@pytest.mark.parametrize("workers", [1, 2])
def test_a_file_that_changes_while_jobs_read_it_ends_the_run(tmp_path, workers):
    lag = tmp_path / "lag"
    lag.write_text("0.5")
    with pytest.raises(InvalidInputError, match=r"lag changed after it was read"):
        over(crashing.changes_it, [str(lag)], tmp_path / "saved", workers)
    assert not list(tmp_path.glob("saved/*.job"))


def test_what_jobs_write_themselves_decides_nothing(tmp_path):
    listed = [(str(tmp_path / "cache"), k) for k in range(3)]
    first = over(crashing.cached, listed, tmp_path / "saved")
    (tmp_path / "cache").write_text("99.0")
    assert over(crashing.cached, listed[:1], tmp_path / "saved") == {0: first[0]}


def test_one_of_ten_saved_jobs_is_repeated_and_where_it_differs_all_run_again(tmp_path):
    listed = [(str(tmp_path), k) for k in range(13)]
    run = functools.partial(over, crashing.logged, listed, tmp_path / "saved", repeat=True)
    right = run()
    assert run(workers=2) == right
    assert ran(tmp_path) == {k: 2 if k in (0, 10) else 1 for k in range(13)}
    for file in (tmp_path / "saved").glob("*.job"):
        result, read = joblib.load(file)
        joblib.dump((result + 1e-12, read), file)
    with pytest.warns(UserWarning, match="than the job gives now: all saved jobs run") as raised:
        assert run() == right
    assert len(raised) == 1
    assert run() == right


@pytest.mark.parametrize(
    ("options", "error"),
    [({"workers": 0}, InvalidInputError), ({"backend": "cloud"}, UnknownNameError)],
)
def test_bad_arguments_are_refused_before_anything_runs(options, error):
    with pytest.raises(error):
        over(abs, [1.0], **options)


def test_what_cannot_be_pickled_is_refused_where_it_is_to_be_saved(tmp_path):
    with pytest.raises(InvalidInputError, match="can be pickled"):
        over(lambda job: job, [1.0], tmp_path)


def test_a_notebook_without_widgets_gets_no_bar_and_no_warning_of_it(monkeypatch, recwarn):
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert over(abs, range(3), title="numbers")
    assert not recwarn


def test_without_a_terminal_lines_report_the_progress(monkeypatch, capsys):
    monkeypatch.setattr(jobs, "PRINTED_EVERY", 0.0)
    over(abs, range(3), title="numbers")
    printed = capsys.readouterr().err
    assert [f"numbers: {k} of 3" in printed for k in (1, 2, 3)] == [True] * 3
