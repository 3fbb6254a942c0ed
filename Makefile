# Everything runs in .venv, which `make setup` creates; every path is relative, so that the clone
# may lie in a folder with any name.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
PY := .venv/bin/python
export PYTHON

.PHONY: help setup demo test same mutants known-mutants stress crash-test lint constants format bench bench-sfm accuracy tradeoff paper benchmark extension window clean

help:  ## This list
	@grep -E '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

setup:  ## Create .venv with the pinned packages (at once if it is there)
	@tools/setup.sh

demo: setup  ## Render a small blurred set of a ball, reconstruct it, write a .blend (demo_output/)
	@$(PY) -m tools.demo

test: setup  ## All tests, files side by side (a quarter of an hour on 2 cores); ARGS="-k word" goes to pytest
	@$(PY) tools/test.py $(ARGS)

same: setup  ## The same twins, to the bit, as the commit in tools/same_reference.txt? ARGS="--against COMMIT"
	@$(PY) tools/same.py $(ARGS)

mutants: setup  ## Mutation testing: break one small thing after the other, drawn at random (hours; ARGS="--seed x --only twin")
	@nice $(PY) -m tools.mutation $(ARGS)

known-mutants: setup  ## Break a copy of the tree in known ways: the tests named beside must see each (minutes)
	@$(PY) -m tools.mutants $(ARGS)

stress: setup  ## Every hard case on this machine; ARGS="--torture" or "--fuzz 100000"
	@$(PY) run_dgs.py stress $(ARGS)

crash-test: setup  ## Pull the plug at every step of every command (an hour, resumable); ARGS="--only rollback"
	@$(PY) -m tools.crash_test $(ARGS)

lint: setup  ## ruff and mypy
	@tools/lint.sh

constants: setup  ## Write docs/constants.md: every number, its reason, and what it was chosen on
	@$(PY) -m tools.constants $(ARGS)

format: setup  ## Let ruff rewrite the code
	@$(PY) -m ruff check --fix .
	@$(PY) -m ruff format .

bench: setup  ## Measure speed; prints a table and writes benchmarks/results.json
	@$(PY) -m benchmarks.speed $(ARGS)

bench-sfm: setup  ## Measure structure from motion on the shared photo sets
	@$(PY) -m benchmarks.sfm $(ARGS)

accuracy: setup  ## Measure accuracy against other ways; ARGS="--data FOLDER --seeds 3"
	@$(PY) -m benchmarks.accuracy $(ARGS)

tradeoff: setup  ## What each knob costs in time and brings (hours, resumable); ARGS="--data FOLDER --seeds 3"
	@$(PY) -m benchmarks.tradeoff $(ARGS)

paper: setup  ## Repeat the paper's experiment (hours, resumable; ARGS="--quick": minutes) and write docs/paper.md
	@$(PY) -m studies.paper $(ARGS)

benchmark: setup  ## Run the product on scenes of many kinds (hours, resumable; ARGS="--quick": minutes) and write docs/benchmark.md
	@$(PY) -m studies.benchmark $(ARGS)

extension: setup  ## Build the Blender extension into dist/
	@$(PY) -m tools.extension

window: setup  ## The panel in real Blenders with a window, 5.2 and 4.3 (needs root; 20 minutes at first)
	@for suite in sid trixie; do tools/window_blender.sh $$suite && \
	  DGS_WINDOW=$$suite DGS_WINDOW_PICTURES=demo_output/window/$$suite $(PY) -m pytest -s tests/gui $(ARGS); done

clean:  ## Remove what can be made again, except .venv and demo_output
	@rm -rf dist build *.egg-info .lint .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
