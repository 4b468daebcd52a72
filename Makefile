# make run: the node on the demo scene.  make test: lint, types, tests.  make bench: figures.
# PYTHON chooses the interpreter of the virtual environment (3.11 or 3.12).
PYTHON ?= python3
VENV := .venv
SCENE ?= config/demo.yaml
BIN := $(VENV)/bin
SOURCES := setup.py setup.cfg package.xml $(shell find procphys_ros scripts config grammars -type f \
  -not -name '*.pyc' -not -name '*.nb?')

.PHONY: run test lint types pytest bench clean

run: $(VENV)/.installed-run
	$(VENV)/lib/procphys_ros/sim --ros-args --params-file $(SCENE)

test: lint types pytest

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .

types: $(VENV)/.installed-test
	$(BIN)/mypy procphys_ros

pytest: $(VENV)/.installed-test
	$(BIN)/python -m pytest

bench: $(VENV)/.installed-test
	for file in bench/*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done

$(BIN)/python:
	./.ci/system-packages $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip

# Installed anew when any source has changed; what it depends on is then there already.
$(VENV)/.installed-run: $(SOURCES) | $(BIN)/python
	rm -rf build
	$(BIN)/pip install --quiet '.[wheels,render,usd,record]'
	@touch $@

$(VENV)/.installed-test: $(SOURCES) | $(BIN)/python
	rm -rf build
	$(BIN)/pip install --quiet '.[wheels,render,test]'
	@touch $@ $(VENV)/.installed-run

clean:
	rm -rf $(VENV) build install log *.egg-info
