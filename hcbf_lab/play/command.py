"""Open a playground in the browser: drag regions, steer, push, and watch who pays for whom."""

import threading
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Literal

from hcbf_gym import policies, scenarios
from hcbf_gym.arguments import Amount, Count, Positive, Range, Seed
from hcbf_lab.play.page import FIRST_PORT, HERE, Page, check_port
from hcbf_lab.play.session import Session
from hcbf_lab.play.settings import HUMAN, Settings


@dataclass(frozen=True)
class Args:
    """Where the page is, and what is chosen at first; all of it can be changed in the page."""

    port: Annotated[int, Range(0, 65_535)] | None = None
    """The port; by default the first free one from 8080 on."""
    model: str = "a1"
    """The A1 with full physics, the reduced-order model alone (reduced), or a robot that takes
    velocities: cart, holonomic-cart, or a contract's path."""
    body: Literal["point", "footprint"] = "point"
    """What must stay outside: the robot's centre, or the whole robot."""
    scenario: str = "random"
    """A name from hcbf_gym.scenarios.names(), or a path to a JSON file."""
    map: Path | None = None
    """A map of Nav2 instead of a scene: YAML beside a PGM or PNG. The seed draws start and goal."""
    masks: dict[str, Count] = field(default_factory=dict)
    """Masks over that map and their ranks: --masks keepout.yaml 2 avoid.yaml 3."""
    slow: dict[str, Positive] = field(default_factory=dict)
    """Masks of zones and the speed limit there [m/s], as rank 2: --slow school.yaml 0.4."""
    policy: str = "pd"
    """pd, human, a learned policy, or one of your own: file.py:function, module:function,
    model.zip, policy.onnx, policy.pt. A zip and a .pt hold pickles, which run code."""
    program: str = "lex-cbf-qp"
    """none, or a name from hcbf_gym.programs.names()."""
    guidance: bool = True
    """Lead to the goal around the regions."""
    margin: Amount | None = None
    """What rows on the position reserve between h and zero [m; default: derived]."""
    gamma0: Amount = 5.0
    """Weight γ₀, where the program has one."""
    delta_gamma: Amount = 1.3
    """Slope Δγ of the weight, where the program has one."""
    seed: Seed = 0
    """Of random scenes and of the episode."""


def main(args: Args) -> None:
    """Serve the page until Ctrl-C."""
    check_port(args.port)
    chosen = {f.name: getattr(args, f.name) for f in fields(Settings) if f.name != "returns"}
    settings = Settings(**chosen)
    scene = scenarios.on_map(args.map, args.masks, args.slow, args.scenario)
    session = Session(settings, scene)
    if settings.policy != HUMAN:
        policies.try_out(settings.policy, session.environment)
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
