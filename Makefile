# `make demo` runs the main job, `make test` runs lint, types and tests. Both set up .venv by themselves.
PYTHON ?= python3
BIN := .venv/bin
# what each worker and each process of a test imports is compiled once, even where the environment says otherwise
export PYTHONDONTWRITEBYTECODE :=

.venv/.ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

.venv/.docs: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,docs]'
	touch .venv/.ready $@

demo: .venv/.ready
	$(BIN)/python examples/andrews.py

lint: .venv/.ready
	$(BIN)/ruff check .
	$(BIN)/pyright

# side by side: types are checked on one core
test: .venv/.ready
	$(MAKE) -j 2 lint laws

laws: .venv/.ready
	$(BIN)/python -m pytest -n auto --dist loadfile

benchmark: .venv/.ready
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,benchmark]'
	$(BIN)/python -m benchmarks

# pages that teach, in docs/_build/index.html; every example on them is run, and warnings are errors
docs: .venv/.docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build

.PHONY: demo lint test laws benchmark docs
