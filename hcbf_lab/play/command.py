"""Open a playground in the browser: drag regions, steer, push, and see which ranks are relaxed."""

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from hcbf_gym import policies, scenarios
from hcbf_gym.arguments import Count, Positive, Range
from hcbf_lab.play.page import FIRST_PORT, HERE, Page, check_port
from hcbf_lab.play.session import Session
from hcbf_lab.play.settings import HUMAN, Settings


@dataclass(frozen=True)
class Args:
    """The address of the page and the first settings, which can be changed in the page."""

    port: Annotated[int, Range(0, 65_535)] | None = None
    """The port; by default the first free one from 8080 on."""
    settings: tyro.conf.OmitArgPrefixes[Settings] = field(default_factory=Settings)
    """The first settings."""
    scenario: str = "random"
    """A name from hcbf_gym.scenarios.names(), or a path to a JSON file."""
    map: Path | None = None
    """A map of Nav2 instead of a scene: YAML beside a PGM or PNG. The seed draws start and goal."""
    masks: dict[str, Count] = field(default_factory=dict)
    """Masks over that map and their ranks: --masks keepout.yaml 2 avoid.yaml 3."""
    slow: dict[str, Positive] = field(default_factory=dict)
    """Masks of zones and the speed limit there [m/s], as rank 2: --slow school.yaml 0.4."""


def main(args: Args) -> None:
    """Serve the page until Ctrl-C."""
    check_port(args.port)
    scene = scenarios.on_map(args.map, args.masks, args.slow, args.scenario)
    session = Session(args.settings, scene)
    if args.settings.policy != HUMAN:
        policies.try_out(args.settings.policy, session.environment)
        session.restart()
    page = Page(session, args.port)
    stop = threading.Event()
    simulation = threading.Thread(target=session.run, args=(stop,), daemon=True)
    if args.port is None and page.port != FIRST_PORT:
        print(f"Port {FIRST_PORT} is taken.")
    print(f"The playground is at {page.address} (Ctrl-C ends it)")
    tunnel = f"ssh -L {page.port}:{HERE}:{page.port} MACHINE"
    print(f"From another machine, open the same address after: {tunnel}", flush=True)
    simulation.start()
    try:
        page.run(stop, simulation)
    except KeyboardInterrupt:
        print()
    finally:
        stop.set()
        simulation.join(timeout=5.0)
        page.close()
