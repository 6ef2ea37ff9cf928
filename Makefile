# Every target but `setup` uses .venv in this checkout and builds it if it is missing.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
DEMO := rm3d_votenet_kitti_1pct

.PHONY: setup demo annotate test fuzz lint types layers bench docs clean

setup: $(STAMP)

$(STAMP): setup.py constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -c constraints.txt 'setuptools>=77.0.3,<82' wheel
	$(BIN)/pip install --quiet -c constraints.txt --no-build-isolation -e '.[test,docs,las,annotate]'
	touch $(STAMP)

demo: $(STAMP)
	$(BIN)/rm3d train $(DEMO) --demo

annotate: $(STAMP)
	$(BIN)/rm3d annotate --demo --classes floor wall chair table

test: $(STAMP)
	$(BIN)/python -m pytest -q

fuzz: $(STAMP)
	RM3D_FUZZ=3000 $(BIN)/python -m pytest -q tests/storage/test_fuzz_readers.py

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

layers: $(STAMP)
	$(BIN)/lint-imports

bench: $(STAMP)
	$(BIN)/rm3d bench --help

docs: $(STAMP)
	$(BIN)/mkdocs build --strict

clean:
	rm -rf $(VENV) build site *.egg-info
