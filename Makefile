# make run: the node on the demo scene, and a page that shows it (at PORT).  make warm: compile all
# kernels.  make test: lint, types, tests.  make bench: figures.  make gallery: pictures.  make docs:
# the site of the documentation.  make report: measurements beside what is expected, with plots.
# PYTHON chooses the interpreter of the virtual environment (3.11 to 3.13).
PYTHON ?= python3
VENV := .venv
SCENE ?= config/demo.yaml
PORT ?= 8080
BIN := $(VENV)/bin
SOURCES := setup.py setup.cfg package.xml $(shell find procphys_ros scripts launch config grammars -type f \
  -not -name '*.pyc' -not -name '*.nb?')

# Scenes of the gallery, and the simulated time of each picture [s].
GALLERY := palms_in_a_gust:3 tree_on_house:5 village_street:3 figure_1:3.2 implosion:3.5 figure_8:3.2 \
  felled_by_wind:3.1 figure_8:8 wrecking_ball:1.5 wrecking_ball:6.5 eroded_valley:0.5 earthquake:15
HOUSES := arcade barn bridge church cottage dry_stone garden_wall office outhouse terrace tower

# What a process has compiled of its modules it keeps for the next, whatever the machine is set to:
# tests start hundreds, and a node is there in a third of the processor time.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: run warm test lint types pytest bench gallery docs report clean

# What the node needs for its first poses it compiles first, the rest beside its steps.
# A shell that waits for the node in the foreground hears no signal before the node has ended, and
# one that comes between a start and the note of its number finds nothing to end yet.  A child that
# has only just been forked may miss a signal, so that the page is sent one until it is gone.
run: $(VENV)/.installed-run
	code=0; trap 'code=130; kill $$page $$node 2>/dev/null' HUP INT TERM; \
	  $(BIN)/view --port $(PORT) & page=$$!; \
	  $(VENV)/lib/procphys_ros/sim --ros-args --params-file $(SCENE) & node=$$!; \
	  test $$code = 0 || kill $$page $$node 2>/dev/null; \
	  wait $$node; ended=$$?; test $$code != 0 || code=$$ended; \
	  while kill $$page 2>/dev/null; do sleep 0.5; done; wait; exit $$code

# Compiles nothing when the user's cache folder has everything.
warm: $(VENV)/.installed-run
	$(BIN)/python -m procphys_ros.warm

test: lint pytest  # types are among the tests

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .

types: $(VENV)/.installed-test
	$(BIN)/mypy procphys_ros

# Kernels first, on all cores: else every node that a test starts would begin to compile them.
# Then three files at a time, also on two cores, because tests of nodes often wait; each has a ROS
# domain of its own, and the longest come first.
pytest: $(VENV)/.installed-test
	$(BIN)/python -m procphys_ros.warm
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder \
	  --durations 40 --durations-min 1

bench: $(VENV)/.installed-test
	for file in bench/*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done

$(BIN)/python:
	@echo 'procphys_ros: the first time this installs packages from PyPI into $(VENV): 2 to 10 minutes, 1.5 GB of'
	@echo 'disk, 2.5 GB for make test. It may install system packages (venv for Python, OpenGL) with apt-get, as'
	@echo 'root or where sudo asks for no password. Compiled kernels: 0.1 GB in the cache folder. Ctrl-C stops.'
	./.ci/system-packages $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip

# Installed anew when any source has changed; what it depends on is then there already.
$(VENV)/.installed-run: $(SOURCES) | $(BIN)/python
	rm -rf build
	$(BIN)/pip install --quiet '.[wheels,render,usd,record,view,maps]'
	@touch $@

$(VENV)/.installed-test: $(SOURCES) | $(BIN)/python
	rm -rf build
	$(BIN)/pip install --quiet --no-compile '.[wheels,render,test]'
	./.ci/browser
	@touch $@ $(VENV)/.installed-run

# The pictures of README.md, docs/scenes.md and docs/walls.md.
gallery: $(VENV)/.installed-run
	for picture in $(GALLERY); do scene=$${picture%:*}; time=$${picture#*:}; \
	  $(BIN)/render config/$$scene.yaml --time $$time --size 800x450 \
	    --out docs/images/$${scene}_$$(echo $$time | tr . _)s.jpg || exit 1; done
	for house in $(HOUSES); do $(BIN)/render $$house.wall --size 760x480 \
	  --out docs/images/wall_$$house.jpg || exit 1; done
	$(BIN)/render config/gust_and_ball.yaml --from 3 --to 7 --fps 10 --size 480x270 \
	  --out docs/images/gust_and_ball.gif

# The site of docs/: build/docs/index.html.  A warning is an error.
docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -W --keep-going -q docs build/docs
	@echo 'open build/docs/index.html'

$(VENV)/.installed-docs: $(SOURCES) | $(BIN)/python
	rm -rf build
	$(BIN)/pip install --quiet '.[docs]'
	@touch $@

# docs/report: what the tests measured beside what is expected, with plots; some five minutes.
report: $(VENV)/.installed-test
	$(BIN)/python -m procphys_ros.warm
	$(BIN)/python bench/report

clean:
	rm -rf $(VENV) build install log *.egg-info
