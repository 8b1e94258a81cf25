"""Through real rclpy, as on the page: robot, node and planner in three processes."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from needs import needs

from hcbf_robots.maps import RankedMap
from hcbf_robots.walkers import Walker

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
ALONE = {
    "ROS_LOCALHOST_ONLY": "1",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_DOMAIN_ID": "101",
    "PYTHONPATH": str(ROOT),
}


@needs("rclpy")
@pytest.mark.physics
def test_the_pages_three_processes_lead_the_cart_round_wall_and_lawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, value in ALONE.items():
        monkeypatch.setenv(name, value)
    exec(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0], {})
    robot, node, planner = (
        shlex.split(re.search(rf"^{begin}.*$", PAGE, re.MULTILINE)[0])[1:]
        for begin in ("hcbf ros-sim", "hcbf ros ", "python examples")
    )
    hcbf = [sys.executable, "-m", "hcbf_gym.cli"]
    started = [
        subprocess.Popen([*hcbf, *words], stderr=subprocess.DEVNULL)
        for words in ([*robot, "--path", "path.npy"], node)
    ]
    try:
        script = [sys.executable, str(ROOT / planner[0]), *planner[1:]]
        done = subprocess.run(script, capture_output=True, text=True, timeout=150, check=False)
        assert done.stdout.endswith("arrived\n"), done.stdout + done.stderr
    finally:
        for one in started:
            one.terminate()
        codes = [one.wait(20) for one in started]
    assert codes == [0, 0]
    places = np.load("path.npy")[:, 1:3]
    rooms = [RankedMap.load(f"{name}.yaml", unknown=None) for name in ("room", "lawn")]
    reach = Walker.load("cart").reach
    least = min(room.distance(places, 1).min() for room in rooms)
    assert least >= reach


@pytest.mark.skipif("rclpy" in sys.modules, reason="rclpy is imported")
def test_without_rclpy_both_ways_to_it_are_named():
    code = (
        "import sys, importlib.util as u; find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'rclpy' else find(name, *a)\n"
        "from hcbf_gym import cli; cli.main(['ros'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 1
    assert "setup.bash" in done.stderr
    assert "ros-wheels" in done.stderr
