#!/usr/bin/env bash
# ruff (rules and format) over everything; mypy over the packages, mounted as `dgs` as at run time.
set -eu
cd "$(dirname "$0")/.."
.venv/bin/python -m ruff check .
.venv/bin/python -m ruff format --check --quiet . || { echo "Not formatted: run make format" >&2; exit 1; }
mkdir -p .lint
ln -sfn .. .lint/dgs  # the clone's own name need not be a Python name
export MYPYPATH=.lint
.venv/bin/python -m mypy -p dgs.core -p dgs.studies -p dgs.command_line -p dgs.dgs_addon -p dgs.operators -p dgs.panels -p dgs.api
