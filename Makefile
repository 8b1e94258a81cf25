# The verbs of CI, for hands.
.PHONY: install test lint types check docs

install:
	pip install -c constraints.txt -e ".[test]"

test:
	pytest

lint:
	ruff check .
	ruff format --check .

types:
	basedpyright

check: lint types test

docs:
	pip install -c constraints.txt -e ".[docs]"
	mkdocs build --strict
