# What a contributor does most, with what the README's second command has installed in .venv; nothing needs a network.
PYTHON ?= .venv/bin/python

.PHONY: fast test lint format docs site tables

fast: ## all tests but the long ones: under two minutes on two quiet cores
	$(PYTHON) -m pytest -q -n auto -m "not slow and not long"

test: ## all tests of a change
	$(PYTHON) -m pytest -q -n auto

lint: ## style and types
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m ty check --python $(PYTHON)

format: ## as lint wants it, as far as a machine can
	$(PYTHON) -m ruff check --fix .
	$(PYTHON) -m ruff format .

docs: ## the tables of docs/metrics.md and docs/spaces.md anew from the code
	$(PYTHON) docs/make_tables.py

site: ## the documentation as a site, in docs/_build/html; any warning ends it
	$(PYTHON) -m sphinx -q -E -W --keep-going -b html docs docs/_build/html

tables: ## published tables anew, those of at most five minutes; of the others it says the commands
	$(PYTHON) benchmarks/tables.py --run
