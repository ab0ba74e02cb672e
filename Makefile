# make            lists the targets
# PYTHON=python3.12 make setup     picks the interpreter of the virtual environment
PYTHON ?= python3
CXX ?= g++
VENV := .venv
BIN := $(VENV)/bin
PY := $(BIN)/python
PIP := $(PY) -m pip --quiet --quiet --disable-pip-version-check
INSTALL := $(PIP) install -c constraints.txt

CORE_FILES := $(shell find core -name '*.cpp' -o -name '*.hpp' -o -name '*.h')
CXX_FILES := $(CORE_FILES) $(shell find examples -name '*.cpp' -o -name '*.hpp')
BUILD_FILES := CMakeLists.txt $(filter-out core/tests/%,$(CORE_FILES))

# Stamps: each is newer than what it was made from, so nothing is installed twice.
TOOLS := $(VENV)/.tools
CORE := $(VENV)/.core
DEV := $(VENV)/.dev

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help setup machine build ros2 test test-fast check test-core tables docs format demo wheel wheels clean

help: ## list the targets
	@sed -n 's/^\([a-z0-9-]*\):.*## \(.*\)/\1\t\2/p' $(MAKEFILE_LIST) | expand -t 12

# Says all that is missing at once, as one line to run.
machine:
	@py=$(notdir $(PYTHON)); missing=; old=; \
	if ! command -v $(PYTHON) >/dev/null; then missing="$$py $$py-venv $$py-dev"; \
	elif ! $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then \
	    py=python3.11; old=1; missing="$$py $$py-venv $$py-dev"; \
	else \
	    $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || missing="$$py-venv"; \
	    $(PYTHON) -c 'import os, sys, sysconfig; \
	        sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' \
	        || missing="$$missing $$py-dev"; \
	fi; \
	command -v $(CXX) >/dev/null || missing="$$missing g++"; \
	if [ -n "$$missing" ]; then \
	    sudo=; [ "$$(id -u)" = 0 ] || sudo="sudo "; \
	    echo "ADRL needs Python >= 3.11 with venv and headers, and a C++ compiler. Run this, then make again$${old:+ with PYTHON=$$py}:" >&2; \
	    echo "$${sudo}apt-get update && $${sudo}apt-get install -y" $$missing >&2; \
	    exit 1; \
	fi

$(PY):
	@$(MAKE) --no-print-directory machine
	@echo "making $(VENV)"
	@$(PYTHON) -m venv $(VENV)

$(TOOLS): constraints.txt | $(PY)
	@echo "installing the build tools"
	@$(INSTALL) cmake ninja nanobind scikit-build-core
	@touch $@

$(CORE): $(TOOLS) pyproject.toml $(BUILD_FILES)
	@echo "building the core, installing what it needs"
	@$(INSTALL) --no-build-isolation --editable '.[train]'
	@touch $@

$(DEV): constraints.txt pyproject.toml | $(CORE)
	@echo "installing the developers' tools"
	@$(INSTALL) --no-build-isolation --editable '.[dev]'
	@touch $@

setup: $(CORE) $(DEV) ## virtual environment with everything, core built

build: $(CORE) ## build the core and install the package, editable

# ROS 2 has an environment of its own. The core is built apart, so that the two never rebuild each other's.
ROS2 := .venv-ros2
ROS2_EXTRA := ros2
ROS2_INSTALL = $(subst $(VENV)/,$(ROS2)/,$(INSTALL)) -c constraints-$(ROS2_EXTRA).txt

ros2: $(ROS2)/.made ## ROS 2 (Kilted) with the package in .venv-ros2; another: ROS2=DIR ROS2_EXTRA=ros2-jazzy

ROS2_INTERFACES := scripts/ros2-interfaces $(wildcard interfaces/CMakeLists.txt interfaces/*/*/*)

$(ROS2)/.made: constraints.txt constraints-$(ROS2_EXTRA).txt pyproject.toml $(BUILD_FILES) $(ROS2_INTERFACES) | machine
	@echo "making $(ROS2)"
	@test -x $(ROS2)/bin/python || $(PYTHON) -m venv $(ROS2)
	@$(ROS2_INSTALL) cmake ninja nanobind scikit-build-core setuptools # empy comes as source: bdist_wheel
	@$(ROS2_INSTALL) --no-build-isolation -C build-dir=build/$(ROS2) --editable '.[$(ROS2_EXTRA),$(ROS2_EXTRA)-interfaces]'
	@$(ROS2)/bin/python scripts/ros2-interfaces
	@touch $@

# The cores share the tests; those marked realtime come last, alone: tests/realtime_last.py.
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m pytest --quiet -n logical --maxprocesses 4 --dist worksteal

test: setup ## all Python tests; PYTEST_ARGS="-k name" picks some
	@$(PYTEST) $(PYTEST_ARGS)

test-fast: setup ## Python tests but the slow ones
	@$(PYTEST) -m "not slow" $(PYTEST_ARGS)

check: setup ## format, lint, types, import layers, documentation, C++ format and tests
	@$(BIN)/ruff format --check --quiet || { echo "run: make format" >&2; exit 1; }
	@$(BIN)/ruff check --quiet
	@$(BIN)/basedpyright
	@$(BIN)/lint-imports --no-logo
	@$(PY) docs/tables.py --check
	@$(MAKE) --no-print-directory docs
	@echo $(CXX_FILES) | xargs --no-run-if-empty $(BIN)/clang-format --dry-run --Werror
	@$(MAKE) --no-print-directory test-core

test-core: $(TOOLS) ## C++ unit tests (Debian package doctest-dev)
	@if echo '#include <doctest/doctest.h>' | $(CXX) -E -x c++ - >/dev/null 2>&1; then \
	    mkdir -p build; PATH="$(CURDIR)/$(BIN):$$PATH"; \
	    cmake -S . -B build/core-tests -G Ninja -DADRL_PYTHON_MODULE=OFF -DADRL_CORE_TESTS=ON -DADRL_WERROR=ON \
	        >build/core-tests.log && \
	    cmake --build build/core-tests -- --quiet && \
	    build/core-tests/core/tests/adrl_core_tests; \
	elif [ "$$CI" = true ]; then \
	    echo "C++ tests: doctest is missing, install doctest-dev" >&2; exit 1; \
	else \
	    echo "C++ tests skipped: doctest is missing (apt-get install doctest-dev)"; \
	fi

tables: $(DEV) ## the tables of README.md and docs/ from the files in docs/results
	@$(PY) docs/tables.py

docs: $(DEV) ## the documentation in build/site; a warning fails
	@said=$$(NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict 2>&1) || { echo "$$said" >&2; exit 1; } # --quiet counts no warnings

format: $(DEV) ## format Python and C++
	@$(BIN)/ruff check --quiet --select I --fix
	@$(BIN)/ruff format --quiet
	@echo $(CXX_FILES) | xargs --no-run-if-empty $(BIN)/clang-format -i

demo: $(CORE) ## drive drawn robots, train for a minute, evaluate on unseen worlds, draw pictures under runs/
	@$(BIN)/adrl demo

wheel: $(TOOLS) ## source archive and wheel in dist/
	@rm -rf dist
	@$(PY) -c 'from scikit_build_core.build import build_sdist; build_sdist("dist")'
	@$(PIP) wheel --no-build-isolation --no-deps --wheel-dir dist dist/*.tar.gz
	@cd dist && ls -1

wheels: ## source archive and wheels for manylinux_2_28 in dist/; PYTHONS="python3.11 python3.12"
	@scripts/wheels $(PYTHONS)

clean: ## remove what was built, but the virtual environment
	@rm -rf build dist .pytest_cache .ruff_cache .import_linter_cache $(CORE)
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
