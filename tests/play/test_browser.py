"""A person's visit to the playground, in a real browser."""

import contextlib
import itertools
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from needs import chromium
from playwright.sync_api import sync_playwright

from hcbf_gym import scenarios
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.scenarios.references import PointReference
from hcbf_lab.play import editing

FLAGS = [
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",
]
WIDTH, HEIGHT = 1000, 640
CAMERA, LOOKS_AT, FIELD_OF_VIEW = np.array([0.0, -0.8, 4.0]), np.zeros(3), 75.0
"""Of the browser, in the scene [m, °]: nearly from above; the panel hides what lies in the east."""
PATIENCE = 240.0
"""How long anything may take [s] before it counts as broken; a busy machine draws slowly."""

SCENE = scenarios.Scenario(
    "course",
    (
        Disc("strict", 1, center=(-2.2, 1.3), radius=0.6),
        Disc("soft", 2, center=(-0.8, -0.5), radius=0.4),
        HalfPlane("wall", 1, normal=(0.0, 1.0), offset=-4.0),
    ),
    PointReference((-6.0, 0.0)),
)
REDUCED = ("--model", "reduced", "--scenario", "paper-simulation")


@contextlib.contextmanager
def playground(*arguments):
    command = [sys.executable, "-m", "hcbf_gym.cli", "play", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    printed = []
    try:
        for line in process.stdout:
            printed.append(line)
            if found := re.search(r"http://\S+", line):
                break
        else:
            pytest.fail(f"hcbf play ended: {''.join(printed)}")
        yield found[0]
    finally:
        process.terminate()
        rest, _ = process.communicate(timeout=PATIENCE)
    assert "Traceback" not in "".join(printed) + rest


def pixel(point, width=WIDTH, height=HEIGHT):
    """Where a point (3,) [m] of the scene is seen by the camera of a fresh tab."""
    ahead = (LOOKS_AT - CAMERA) / np.linalg.norm(LOOKS_AT - CAMERA)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    ray = np.array(point) - CAMERA
    focal = 0.5 * height / np.tan(np.radians(0.5 * FIELD_OF_VIEW)) / (ray @ ahead)
    across, up = focal * (ray @ right), focal * (ray @ np.cross(right, ahead))
    return 0.5 * width + across, 0.5 * height - up


class Visit:
    """A tab on the playground, with the readings that it shows."""

    def __init__(self, browser, url, width=WIDTH, height=HEIGHT):
        self.size = width, height
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.set_default_timeout(1000 * PATIENCE)
        eye, target = (",".join(map(str, point)) for point in (CAMERA, LOOKS_AT))
        mark = "&" if "?" in url else "?"
        self.page.goto(f"{url}{mark}initialCameraPosition={eye}&initialCameraLookAt={target}")
        self.page.wait_for_selector('[data-reading="status"]')

    def readings(self):
        """Return name → text of all that the page reads at one instant."""
        return self.page.evaluate(
            "Object.fromEntries([...document.querySelectorAll('[data-reading]')]"
            ".map(part => [part.dataset.reading, part.textContent]))"
        )

    def reading(self, name):
        return self.readings()[name]

    def number(self, name):
        return float(re.match(r"[+-]?[\d.]+", self.reading(name))[0])

    def position(self):
        return tuple(map(float, re.findall(r"-?[\d.]+", self.reading("position"))))

    def happens(self, condition, within=PATIENCE):
        """Return whether a condition comes to hold within so many seconds."""
        end = time.monotonic() + within
        while not condition():
            if time.monotonic() > end:
                return False
            time.sleep(0.1)
        return True

    def until(self, condition, what):
        assert self.happens(condition), f"waited for {what}: {self.readings()}"

    def settled(self, field):
        """Return a field's value once it has stayed the same for a while."""
        seen = []

        def stays():
            seen.append(field.input_value())
            return len(seen) >= 10 and len(set(seen[-10:])) == 1

        self.until(stays, "a field to settle")
        return seen[-1]

    def until_reads(self, name, text):
        self.until(lambda: text in self.reading(name), f"{name} to read {text!r}")

    def tab(self, name):
        self.page.get_by_role("tab", name=name).click()

    def button(self, name):
        self.page.get_by_role("button", name=name).click()

    def field(self, label):
        """Return the inputs that follow a label."""
        name = self.page.get_by_text(label, exact=True)
        return name.locator("xpath=following::input[not(@type='hidden')]")

    def choose(self, label, option):
        self.field(label).first.click()
        self.page.locator("[role=option]:visible").get_by_text(option, exact=True).click()

    def type(self, label, *values):
        for k, value in enumerate(values):
            box = self.field(label).nth(k)
            box.fill(str(value))
            box.press("Enter")

    def shows_the_scene(self, x, y):
        """Return whether a pixel shows the scene; a notice that lies over it is closed first.

        Where WebGL draws in software, viser shows a notice that stays over the scene.
        """
        notices = self.page.locator(".mantine-Notification-closeButton")
        if notices.count():
            notices.first.click()
        at = "([x, y]) => document.elementFromPoint(x, y).tagName"
        return self.page.evaluate(at, [x, y]) == "CANVAS"

    def grasp(self, handle, scale):
        """Press the mouse on the square of a handle that stands at (3,) [m]."""
        middle = scale * (1.0 / 7.0 + 0.225 / 2.0)  # of the square between the arrows
        place = pixel(np.add(handle, (middle, middle, 0.0)))
        self.until(lambda: self.shows_the_scene(*place), "nothing to lie over the handle")
        self.page.mouse.move(*place)
        self.page.mouse.down()
        return middle

    def click_on(self, point):
        """Click on a point (2,) [m] of the floor."""
        place = pixel((*point, 0.0), *self.size)
        self.until(lambda: self.shows_the_scene(*place), "nothing to lie over the floor")
        self.page.mouse.click(*place)

    def pull(self, start, end):
        """Move the mouse from above one point (3,) [m] to another, as a hand does."""
        for share in np.linspace(0.0, 1.0, 6)[1:]:
            self.page.mouse.move(*pixel((1.0 - share) * np.array(start) + share * np.array(end)))


@pytest.fixture(scope="module")
def browser(pytestconfig):
    if not pytestconfig.getoption("with_browser"):
        pytest.skip("needs minutes in a browser: pytest --with-browser")
    path = chromium()
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def album(tmp_path):
    """A function that takes a picture of a visit, for people: into $HCBF_PICTURES if given."""
    folder, count = Path(os.environ.get("HCBF_PICTURES", tmp_path)), itertools.count(1)

    def picture(visit, name):
        visit.page.screenshot(path=folder / f"{next(count)}-{name}.png")

    return picture


def drag_the_region_over_the_way(visit):
    """Drag it until it lies there: a browser that draws in software misses some of a hand's way."""
    visit.tab("Scene")
    place = visit.field("place [m]")
    for _ in range(3):
        x, y = (float(place.nth(axis).input_value()) for axis in (0, 1))
        reach = visit.grasp((x, y, 0.1), 0.6)
        visit.pull((x + reach, y + reach, 0.1), (x + reach, reach, 0.1))
        visit.page.mouse.up()
        if visit.happens(lambda: abs(float(place.nth(1).input_value())) < 0.2, PATIENCE / 4):
            return
    raise AssertionError(f"the region does not lie on the way: {visit.readings()}")


def steer_into_rank_1(visit):
    """Hold the stick in the midst of the region for 10 s; return the readings meanwhile."""
    x, y = visit.position()
    reach = visit.grasp((x, y, 0.5), 0.35)
    visit.pull((x + reach, y + reach, 0.5), (-2.2 + reach, reach, 0.5))
    visit.until(lambda: visit.position()[0] < -0.1, "the robot to follow the stick")
    over, seen = visit.number("time") + 10.0, []

    def is_over():
        seen.append(visit.readings())
        return float(seen[-1]["time"]) >= over

    visit.until(is_over, "the stick to be held for 10 s")
    return seen


def push_into_rank_1(visit):
    """Push, harder each time, and return whether the robot has been inside."""
    for force in (60.0, 70.0, 80.0, 90.0):
        visit.type("push [N]", -force, -force)
        visit.button("push the trunk")
        over = visit.number("time") + 2.0
        visit.until(lambda over=over: visit.number("time") > over, "the push to be over")
        if visit.number("least-1") < 0.0:
            return True
    return False


@pytest.mark.physics
def test_a_person_drags_steers_pushes_saves_and_loads(browser, tmp_path, album):
    file = tmp_path / "course.json"
    file.write_bytes(editing.to_json(SCENE))
    first = ("--scenario", str(file), "--policy", "human", "--program", "eh-cbf-qp")
    with playground("--port", "0", *first) as url:
        visit = Visit(browser, url)
        visit.until(lambda: visit.number("time") > 1.0, "the robot")
        assert visit.reading("program") == "eh-cbf-qp"
        visit.field("follow the robot").first.click()  # else pixels move while a slow hand drags
        visit.tab("Filter")
        visit.choose("program", "lex-cbf-qp")
        visit.until_reads("program", "lex-cbf-qp")
        album(visit, "program")

        drag_the_region_over_the_way(visit)
        album(visit, "region")

        seen = steer_into_rank_1(visit)
        album(visit, "steered")
        visit.page.mouse.up()
        assert min(float(one["least-1"].split()[0]) for one in seen) >= 0.0
        assert float(seen[-1]["h-1"].split()[0]) < 0.3  # it did press against the region
        statuses = {one["status"] for one in seen}
        assert "SAFE" in statuses
        assert statuses <= {"NOMINAL", "SAFE", "RELAXED"}

        visit.tab("Drive")
        rounds = 0
        while not push_into_rank_1(visit):  # it was pushed along the region: once more from near it
            rounds += 1
            assert rounds < 3, f"no push threw it into the region: {visit.readings()}"
            steer_into_rank_1(visit)
            visit.page.mouse.up()
        visit.until(lambda: visit.number("h-1") >= 0.0, "the robot to come out")
        visit.until(lambda: visit.reading("status") in ("NOMINAL", "SAFE"), "the robot to recover")
        album(visit, "pushed")

        visit.tab("Plots")
        chart = visit.page.locator(".uplot canvas").first
        before = chart.evaluate("canvas => canvas.toDataURL()")
        visit.until(lambda: chart.evaluate("canvas => canvas.toDataURL()") != before, "the plots")
        album(visit, "plots")

        visit.field("pause").first.click()
        visit.until_reads("state", "paused")
        still = visit.reading("time")
        visit.tab("Scene")
        with visit.page.expect_download() as download:
            visit.button("save the scene")
        saved = tmp_path / "saved.json"
        download.value.save_as(saved)
        kept = scenarios.load(saved)
        assert np.allclose(editing.region(kept, "strict").center, (-2.2, 0.0), atol=0.2)
        assert visit.reading("time") == still
        album(visit, "paused")

        renamed = tmp_path / "renamed.json"
        renamed.write_text(json.dumps(json.loads(saved.read_text()) | {"name": "again"}))
        visit.page.locator('input[type="file"]').set_input_files(renamed)
        visit.until_reads("scene", "again")
        assert visit.number("time") < float(still)
        assert editing.region(kept, "strict") == editing.region(scenarios.load(renamed), "strict")
        album(visit, "loaded")


def test_a_refused_command_is_reported_in_the_page(browser, tmp_path, album):
    with playground("--port", "0", *REDUCED) as url:
        visit = Visit(browser, url)
        visit.field("pause").first.click()  # a course that begins again shows its own message
        visit.until_reads("state", "paused")
        visit.tab("Scene")
        visit.choose("region", "h3 region 1")
        size = visit.field("size [m]").first
        visit.until(lambda: not size.is_disabled(), "the region's size")
        before = visit.settled(size)
        size.fill("0")
        size.press("Enter")
        visit.until_reads("message", "expected a number > 0")
        visit.until(lambda: size.input_value() == before, "the slider to go back")
        album(visit, "radius")
        broken = tmp_path / "broken.json"
        broken.write_text("{")
        visit.page.locator('input[type="file"]').set_input_files(broken)
        visit.until_reads("message", "is no JSON")
        assert visit.reading("scene") == "paper-simulation"
        album(visit, "broken")


def test_of_two_browsers_one_steers_and_a_closed_tab_frees_the_controls(browser, album):
    with playground("--port", "0", *REDUCED) as url:
        first, second = Visit(browser, url), Visit(browser, url)
        first.choose("policy", "human")
        second.until_reads("policy", "human")
        second.choose("policy", "pd")
        second.page.get_by_text("Somebody else steers").first.wait_for()
        assert first.reading("policy") == "human"
        album(second, "refused")
        second.button("take the controls")
        second.page.get_by_text("You steer").first.wait_for()
        second.choose("policy", "pd")
        first.until_reads("policy", "pd")
        second.page.close()
        first.until_reads("steering", "no one steers")
        first.choose("policy", "human")
        first.until_reads("policy", "human")


def test_a_phone_sees_a_robot_under_way_and_the_panel(browser, album):
    with playground("--port", "0", "--model", "reduced") as url:
        visit = Visit(browser, url, 390, 844)
        assert visit.reading("program") == "lex-cbf-qp"
        visit.until(lambda: visit.number("time") > 1.0, "the robot")
        assert visit.number("time") < 60.0  # it waited for a browser
        assert "derived" in visit.reading("margin")
        for place in itertools.product((0.5, -0.5), (0.5, 0.8, 1.1)):  # some lie in a region
            visit.click_on(place)
            if visit.happens(lambda: "The goal is at " in visit.reading("message"), PATIENCE / 48):
                break
        visit.until_reads("message", "The goal is at ")
        sheet = visit.page.locator(".mantine-Paper-root", has=visit.page.locator("[data-reading]"))
        place = sheet.bounding_box()
        assert place["width"] == 390
        assert place["y"] > 0.5 * 844
        visit.until(lambda: visit.shows_the_scene(195, 300), "the scene above the panel")
        album(visit, "phone")
