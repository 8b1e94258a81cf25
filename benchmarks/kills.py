"""A run that is killed again and again, and ends as one that was left alone.

``python -m benchmarks.kills`` counts entries of hostile episodes on the reduced-order model, while
workers, a node and the whole command are killed at random, and says what was run again. Linux.
"""

import contextlib
import functools
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console

from hcbf_gym.errors import require
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.evaluation.statistics import CONFIDENCE, upper_bound
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.evaluation.workers import Backend

FIRST_SEED = 11_000_000
MARK = "HCBF_KILLS"
"""The variable by which processes of this run are told from all others."""


def walk(seed: int, log: Path) -> float:
    """Return the least strict h of a hostile episode of four seconds [m]; note that it ran."""
    attack = tuple(ATTACKS)[seed % len(ATTACKS)]
    episode = AttackedEpisode(attack, "random", seed, "HCBF-Regions-v0", {"max_episode_steps": 200})
    _note(log / "begun", f"{seed} {os.getpid()}")
    least = episode.run().least_h
    _note(log / "ended", f"{seed} {os.getpid()}")
    return least


def _note(file: Path, line: str) -> None:
    with file.open("a", encoding="utf-8") as stream:
        stream.write(line + "\n")


def _notes(file: Path) -> list[list[int]]:
    """Return what was noted, but for a line that is being written."""
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    return [[int(word) for word in line.split()] for line in text.split("\n")[:-1]]


def count(folder: Path, episodes: int, backend: Backend) -> None:
    """Run what is missing in the folder, and write what all of it says."""
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    runs = Runs(folder / "episodes", 2 if backend == "processes" else None, backend)
    least = in_order(runs.over(functools.partial(walk, log=folder), seeds))
    entered = sum(h < 0.0 for h in least)
    bound = upper_bound(entered, episodes)
    write_json(
        folder / "count.json",
        {
            "episodes": episodes, "entered": entered, "bound": bound, "confidence": CONFIDENCE,
            "least_h": least,
        },
    )  # fmt: skip


def broken(
    folder: Path, episodes: int, backend: Backend, kills: int, rng: random.Random
) -> dict[str, Any]:
    """Run the count while it is killed; return how often whom, and what ran again.

    Args:
        folder: of the run.
        episodes: to count.
        backend: who runs them; on Ray, one of two nodes is killed half way.
        kills: how often.
        rng: decides when, and whom.
    """
    folder.mkdir()
    killed = {"workers": 0, "commands": 0, "nodes": 0}
    os.environ[MARK] = folder.name
    nodes = _two_nodes() if backend == "ray" else contextlib.nullcontext()
    with nodes as kill_node:
        command = _start(folder, episodes, backend)
        for n in range(kills):
            _wait(command, folder, rng.randint(1, episodes // (2 * kills)))
            time.sleep(rng.uniform(0.0, 0.5))
            if kill_node is not None and n == kills // 2:
                kill_node()
                killed["nodes"] += 1
            elif n % 2:
                command.kill()
                command.wait()
                command = _start(folder, episodes, backend)
                killed["commands"] += 1
            else:
                killed["workers"] += _kill_worker(folder, rng)
        if command.wait() != 0:
            raise SystemExit("kills: the command failed, expected that it resumes")
    ended = [seed for seed, _ in _notes(folder / "ended")]
    return killed | {"episodes": len(set(ended)), "run again": len(ended) - len(set(ended))}


def _start(folder: Path, episodes: int, backend: Backend) -> subprocess.Popen[bytes]:
    module = ("-m", "benchmarks.kills", "--episodes", str(episodes), "--only", str(folder))
    quiet = os.environ | {"PYTHONWARNINGS": "ignore"}  # of what killed processes leave behind
    return subprocess.Popen([sys.executable, *module, "--backends", backend], env=quiet)


def _wait(command: subprocess.Popen[bytes], folder: Path, more: int) -> None:
    """Wait for the end of so many more episodes."""
    goal = len(_notes(folder / "ended")) + more
    while len(_notes(folder / "ended")) < goal:
        if command.poll() is not None:
            raise SystemExit("kills: the command ended too early, expected it to be killed first")
        time.sleep(0.02)


def _kill_worker(folder: Path, rng: random.Random) -> int:
    """Kill a process that runs an episode; return how many were found to kill."""
    ended = {tuple(note) for note in _notes(folder / "ended")}
    pids = {pid for seed, pid in _notes(folder / "begun") if (seed, pid) not in ended}
    alive = sorted(pid for pid in pids if _is_ours(pid, folder.name))
    if not alive:
        return 0
    os.kill(rng.choice(alive), signal.SIGKILL)
    return 1


def _is_ours(pid: int, name: str) -> bool:
    """Tell whether a process lives and was begun by this run."""
    try:
        return f"{MARK}={name}".encode() in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return False


@contextlib.contextmanager
def _two_nodes() -> Iterator[Any]:
    """Start a Ray cluster of two nodes with two CPUs each; give what kills the second."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2})
    second = cluster.add_node(num_cpus=2)
    os.environ["RAY_ADDRESS"] = str(cluster.address)
    try:
        yield lambda: cluster.remove_node(second, allow_graceful=False)
    finally:
        del os.environ["RAY_ADDRESS"]
        cluster.shutdown()


def main(
    backends: tuple[Backend, ...] = ("processes", "ray"),
    episodes: int = 600,
    kills: int = 10,
    seed: int = 0,
    only: Path | None = None,
) -> None:
    """Count once unbroken and once under each backend while it is killed; print what ran again.

    Args:
        backends: who runs the episodes.
        episodes: to count.
        kills: of workers and commands in turn, and on Ray of a node.
        seed: decides when, and whom.
        only: count in this folder, and nothing else.
    """
    if only is not None:
        count(only, episodes, backends[0])
        return
    if "ray" in backends:
        require("benchmarks.kills --backends ray", "cluster", "ray")
    rng = random.Random(seed)
    rows, figures = [], {}
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name) / "whole"
        whole.mkdir()
        count(whole, episodes, "processes")
        expected = (whole / "count.json").read_bytes()
        for backend in backends:
            folder = Path(name) / backend
            found = broken(folder, episodes, backend, kills, rng)
            same = (folder / "count.json").read_bytes() == expected
            figures[backend] = found | {"same": same}
            share = 1.0 - found["run again"] / found["episodes"]
            rows.append((backend, *map(str, found.values()), f"{share:.1%}", str(same)))
        told = json.loads(expected)
    header = ("killed", "workers", "commands", "nodes", "episodes", "finished, run again")
    header += ("not run again", "same bits")
    bound = f"{told['entered']} of {told['episodes']} entered, at most {told['bound']:.2%}"
    Console(width=120).print(Table(f"Killed and resumed: {bound}", header, rows).rich())
    if not all(f["same"] and f["run again"] <= 0.1 * f["episodes"] for f in figures.values()):
        raise SystemExit("kills: expected the same result, and 90 % of the episodes not run again")


if __name__ == "__main__":
    from benchmarks import kills  # under its own name, by which workers find it

    tyro.cli(kills.main)
