"""What a plant says of itself, as certificates compare it."""

import hashlib
import inspect
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Plant, read


def declared(plant: Plant, env: Any, observation: Any, info: dict[str, Any]) -> dict[str, Any]:
    """Return what tells a plant from another one, in JSON's terms.

    A plant that declares nothing by itself is told by its environment's class, its model, U, its
    period, and a hash of the files in which environment and readers are written.

    Args:
        plant: that a filter has.
        env: unwrapped.
        observation: the latest.
        info: the latest.

    Raises:
        InvalidInputError: if it declares nothing.
    """
    if plant.declared is not None:
        said: Mapping[str, Any] = read(plant.declared, env, observation, info)
        if not said:
            raise InvalidInputError(
                f"plant: got declared {said!r}, which any plant matches; expected what tells it "
                "from others, or None"
            )
        return records.plain(dict(said))
    input_set = plant.input_set
    return {
        "environment": type(env).__name__,
        "model": type(plant.model).__name__,
        "states": plant.model.n,
        "inputs": plant.model.n_u,
        "input set": None if input_set is None else records.plain(input_set.to_dict()),
        "period": plant.period,
        "files": files_hash(_written_in(type(env), plant.state, plant.barriers)),
    }


def robot_of(name: str, files: Iterable[Path]) -> str:
    """Return what certificates call a robot: its name, and a hash of what its files hold."""
    return f"{name} {files_hash(files)}"


def files_hash(files: Iterable[Path]) -> str:
    """Return a hash of what files hold, whatever they are called."""
    digests = {hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    return hashlib.sha256(" ".join(sorted(digests)).encode()).hexdigest()[:16]


def _written_in(*things: Any) -> set[Path]:
    """Return the files in which classes and functions are written; none for what has none."""
    found = set()
    for thing in things:
        try:
            file = inspect.getsourcefile(thing)
        except TypeError:  # an instance, or built in
            continue
        if file is not None and Path(file).is_file():
            found.add(Path(file))
    return found
