"""`python -m benchmarks [SUITE]` takes figures; with the name of pictures, it draws them."""

import sys
from collections.abc import Sequence

from benchmarks.registry import SUITES
from hcbf_gym import cli

PICTURES = {  # name → module with `Args` and `main(args)`
    "between-samples": "benchmarks.pictures.between_samples",
    "conflict": "benchmarks.pictures.conflict",
    "fields": "benchmarks.pictures.fields",
    "gallery": "benchmarks.pictures.gallery",
    "input-plane": "benchmarks.pictures.input_plane",
    "weights": "benchmarks.pictures.weights",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Take figures or draw pictures; an error of the package ends it in one line."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments and arguments[0] in SUITES:
        arguments.insert(0, "--suite")
    name = arguments.pop(0) if arguments and arguments[0] in PICTURES else ""
    module = PICTURES.get(name, "benchmarks.command")
    cli.run(module, f"python -m benchmarks {name}".rstrip(), arguments)


if __name__ == "__main__":
    main()
