# make run: the node on the demo scene.  make test: lint, types, tests.  make bench: figures.
# PYTHON chooses the interpreter of the virtual environment (3.11 or 3.12).
PYTHON ?= python3
VENV := .venv
SCENE ?= config/demo.yaml
BIN := $(VENV)/bin
PACKAGE_FILES := setup.py setup.cfg package.xml $(wildcard scripts/*)

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

# Editable: edited code, grammars and scenes take effect at once.
$(VENV)/.installed-run: $(PACKAGE_FILES) | $(BIN)/python
	$(BIN)/pip install --quiet --editable '.[wheels]'
	@touch $@

$(VENV)/.installed-test: $(PACKAGE_FILES) | $(BIN)/python
	$(BIN)/pip install --quiet --editable '.[wheels,render,test]'
	@touch $@ $(VENV)/.installed-run

clean:
	rm -rf $(VENV) build install log *.egg-info
