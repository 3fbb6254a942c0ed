#!/usr/bin/env bash
# ruff over everything; mypy over the packages, mounted as `dgs` as at run time.
set -eu
cd "$(dirname "$0")/.."
.venv/bin/python -m ruff check .
mkdir -p .lint
ln -sfn .. .lint/dgs  # the clone's own name need not be a Python name
export MYPYPATH=.lint
.venv/bin/python -m mypy -p dgs.core -p dgs.dgs_addon -p dgs.operators -p dgs.panels
