# The verbs of CI, for hands.
.PHONY: core install test lint types imports check docs quick ci full

# The compiled part, into hcbf_gym/. PYTHON=… of another environment; needs the extra `core`.
PYTHON ?= python
core:
	$(PYTHON) build_backend/in_place.py

install:
	pip install -c constraints.txt -e ".[test]"

test:
	pytest

lint:
	ruff check .
	ruff format --check .

types:
	basedpyright

imports:
	lint-imports

check: lint types imports test

docs:
	pip install -c constraints.txt -e ".[docs]"
	python -m benchmarks --check
	zensical build --strict

quick:
	python -m benchmarks --suite course filter verify-programs monte-carlo --quick

ci:
	.ci/run

full:
	.ci/full
