# The verbs of CI, for hands.
.PHONY: core aarch64 install test lint types imports check docs quick ci full

# The compiled part, into hcbf_gym/. PYTHON=… of another environment; needs the extra `core`.
PYTHON ?= python
core:
	$(PYTHON) build_backend/in_place.py

# After `make core`, a wheel for Linux on aarch64 from any other, by Python 3.12 or newer with ziglang.
ZIG = $(PYTHON) -Im ziglang
TARGET = -target aarch64-linux-gnu.2.28
aarch64:
	mkdir -p build/aarch64
	cp hcbf_gym/_core.pyi build/aarch64
	CC="$(ZIG) cc $(TARGET)" CXX="$(ZIG) c++ $(TARGET)" _PYTHON_HOST_PLATFORM=manylinux_2_28-aarch64 \
	CMAKE_ARGS="-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64" \
	$(PYTHON) -m pip wheel --no-deps -w dist -C build-dir=build/aarch64 -C build.targets=_core .

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
