# SPDX-License-Identifier: GPL-3.0-or-later
# `make demo` and `make test` set up what they need in .venv. PYTHON=... chooses the Python by hand.

VENV := .venv
RUN := $(VENV)/bin/python
READY := $(VENV)/.ready
ARGS ?=
SHARED_SCENES := $(wildcard ../shared/scenes)

export PIP_CACHE_DIR := $(CURDIR)/.cache/pip
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Blender finds no preferences and no extensions of the user here, and leaves none.
export BLENDER_USER_RESOURCES := $(CURDIR)/.cache/blender

ifneq ($(SHARED_SCENES),)
export SSGI_SCENES ?= $(abspath $(SHARED_SCENES))
endif

# How many times their examples property tests try
TIMES ?= 5

.PHONY: help env demo test stress lint bench bench-tracer pictures docs package wheel clean

help:
	@echo "make env      environment with Blender as a Python module, in $(VENV)"
	@echo "make demo     the whole job on the demo scene; prints where the picture is"
	@echo "make test     all tests (ARGS='-k name' for some)"
	@echo "make stress   property tests with 5 times their examples (ten minutes; TIMES=100: more; ARGS='-k any_')"
	@echo "make lint     style and types"
	@echo "make bench    error against time, ours and Blender's own ways, in bench/index.html (ARGS=--quick: minutes)"
	@echo "make bench-tracer  speed and memory of the tracer, in benchmarks/results (minutes; keep the machine quiet)"
	@echo "make pictures the pictures of docs/reflections.md (minutes; ARGS='rays reuse' for some)"
	@echo "make docs     the site, in docs/_build/html (ARGS=--committed: draws no pictures, --all: Blender's too)"
	@echo "make package  the extension, in dist/ (ARGS=--help: other archives)"
	@echo "make wheel    the Python package, in dist/"
	@echo "make clean    remove the environment and everything that was built"

env: $(READY)

# Blender 5.2 runs in Python 3.13, Blender 5.0 in 3.11; pyproject.toml picks the one that fits.
$(READY): pyproject.toml .ci/find-python .ci/check_blender.py
	@python="$(PYTHON)"; [ -n "$$python" ] || python=$$(.ci/find-python 3.13 3.11) || exit 1; \
	echo "environment: $$($$python --version) in $(VENV)"; \
	$$python -m venv --clear $(VENV)
	@mkdir -p "$(BLENDER_USER_RESOURCES)"
	@$(RUN) -m pip install -qq --editable '.[blender,dev]'
	@$(RUN) -m pip install -qq --editable '.[metrics]' || echo "FLIP has no package for this Python: reports leave it out"
	@$(RUN) .ci/check_blender.py
	@touch $@

demo: $(READY)
	@$(RUN) -m ssgi_addon demo $(ARGS)

test: $(READY)
	@$(RUN) -m pytest $(ARGS)

# Other examples in each run; prints how many were tried
stress: $(READY)
	@$(RUN) -m pytest -m property --stress $(TIMES) $(ARGS)

lint: $(READY)
	@$(RUN) -m ruff check
	@$(RUN) -m ruff format --check
	@$(RUN) -m mypy

# All scenes of SSGI_SCENES; without that folder the demo
bench: $(READY)
	@$(RUN) -m pip install -qq --editable '.[bench]'
	@$(RUN) -m ssgi_addon bench --output bench $(ARGS)

bench-tracer: $(READY)
	@$(RUN) -m pip install -qq --editable '.[bench]'
	@$(RUN) -m benchmarks.tracer_speed --output benchmarks/results/tracer_speed.json $(ARGS)
	@$(RUN) -m benchmarks.scaling --output benchmarks/results/scaling.json $(ARGS)
	@$(RUN) -m benchmarks.summary

pictures: $(READY)
	@$(RUN) -m docs.pictures.reflections $(ARGS)

docs: $(READY)
	@$(RUN) -m pip install -qq --editable '.[docs]'
	@$(RUN) -m docs.pictures $(ARGS)
	@$(RUN) -m sphinx -q -W --keep-going docs docs/_build/html
	@echo "docs/_build/html/index.html"

# The extension with the wheels of all systems (ARGS=--no-wheels, ARGS=--split-platforms)
package: $(READY)
	@$(RUN) -m release $(ARGS)

# The Python package; the wheel is made from the source archive, which so is known to be complete
wheel: $(READY)
	@$(RUN) -m build --outdir dist >/dev/null
	@ls dist/ssgi-*.whl dist/ssgi-*.tar.gz

clean:
	rm -rf $(VENV) .cache build dist ssgi.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
