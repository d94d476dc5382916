# Everything that is done with the project as a whole. Needs Python 3.11 or newer, pip and make; the rest goes into .venv.
#   make demo       a rig that sticks and slips, a controller, a recording and a figure
#   make test       the tests            make test-slow   those that take longer
#   make test-browser  the page of rig web in Chromium; it says what to install
#   make screenshots  pictures of twelve states of the page at three widths, build/screenshots
#   make check      formatting, lint, order of modules, import rules, types
#   make bench      figures for this machine; make bench AGAINST=COMMIT: speed over that of another version;
#                   make bench LOOP=600: the loop over the bus alone, with a paced run of ten minutes
#   make docs       the figures of the papers, made again: docs/gallery, and build/gallery/README.md with all numbers
#   make tables     what docs/benchmarks, cost, effects, torture and peers show, measured again: on an idle machine, with the extra peers
#   make pictures   the pictures of README, made again (that of the page needs Chromium)
#   make tracks     the moving pictures of the page's opening, made again
#   make slidermaps the maps beside the sliders of the page, made again (an hour)
#   make lessons    figures and printed lines of docs/lessons, made again by the commands of the lessons
#   make site       the documentation as a site, build/site/index.html (installs Sphinx into .venv the first time)
#   make golden     recordings/golden, made again
#   make proto      code of the .proto files, made again (needs protoc: apt-get install protobuf-compiler)
#   make lock       the three requirements files, made again from pyproject.toml (needs uv)
#   make tools      what tests and checks need, and all optional libraries
#   make uninstall  .venv and the caches of this user deleted; recordings stay

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PROCESSES := $(addprefix tests/web/test_,web_runs.py recordings.py studies.py web_command.py) $(addprefix tests/analysis/test_,cluster.py lockstep_proof.py) \
    $(addprefix tests/bench/test_,runs.py board_runs.py remote_runs.py streams.py live_checkpoint.py in_plant.py pace.py plant.py plant_controllers.py \
    plant_operators.py plant_rebuilds.py recorder_outcome.py triggered_run.py) \
  $(addprefix tests/controllers/test_,device.py real_process.py) $(addprefix tests/cli/test_cli_,live.py tickets.py) tests/qualify/test_board_link.py \
  tests/parts/test_live.py tests/view/test_bridge.py $(addprefix tests/web/test_,bridge.py share.py) tests/test_child.py \
  $(addsuffix /test_process.py,tests tests/controllers tests/record) $(addprefix tests/bus/test_,access.py processes.py session.py tickets.py wire.py)
DAILY := not slow and not bench and not browser and not peers
RUN := $(BIN)/python -m
PIP := $(RUN) pip install --quiet --disable-pip-version-check

.DEFAULT_GOAL := install
.PHONY: install tools demo test test-slow test-browser screenshots check bench docs tables pictures tracks slidermaps lessons site golden proto lock uninstall clean

install: $(VENV)/.installed
tools: $(VENV)/.installed-tools

# $(1): the lock file. What pip collects is counted, because nothing else would be seen for minutes.
define installed
@command -v $(PYTHON) >/dev/null || { echo "there is no '$(PYTHON)' here: install Python 3.11 or newer, or name it: make PYTHON=python3.12"; exit 1; }
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed; $(PYTHON) is $$($(PYTHON) -V 2>&1). Another one: make PYTHON=python3.12"; exit 1; }
@echo "download and install: about $$(grep -c '^[a-z].*==' $(1)) packages into $(VENV), once; one to three minutes"
@$(PYTHON) -m venv $(VENV) || { echo "Python's venv module is missing: install it (often a package named python3-venv)"; exit 1; }
@{ $(RUN) pip install --disable-pip-version-check --progress-bar off --require-hashes -r $(1) 2>&1; echo "ended $$?"; } \
  | awk -v whole=$$(grep -c '^[a-z].*==' $(1)) '/^(Collecting|Processing) /{ if (++n % 20 == 0) { print "  " n " of about " whole " packages"; fflush() } } \
    /^Installing /{ print "  all there, installing"; fflush() } /^(ERROR|error)/{ print; fflush() } END{ exit $$2 }'
@$(PIP) --no-deps --no-build-isolation -e .
@touch $(VENV)/.installed
endef

$(VENV)/.installed: requirements.lock pyproject.toml
	$(call installed,requirements.lock)

$(VENV)/.installed-tools: requirements-dev.lock requirements.lock pyproject.toml
	$(call installed,requirements-dev.lock)
	@touch $@

demo: install # a busy machine makes the timing invalid (3) and says so; the demonstration is none the worse
	@$(BIN)/rig demo || [ $$? -eq 3 ]

test: export PYTHONDONTWRITEBYTECODE = # or each of some hundred processes would compile rig anew
test: tools # what computes, one thread each; then processes, which mostly wait, four at a time, the longest first; then what judges time, alone
	@OPENBLAS_NUM_THREADS=1 $(RUN) pytest -n 2 --dist loadfile $(addprefix --ignore=,$(PROCESSES))
	@$(RUN) pytest -n 4 --dist worksteal -m "$(DAILY) and not alone" $(PROCESSES)
	@$(RUN) pytest -m "$(DAILY) and alone" $$(grep -l mark.alone $(PROCESSES))

test-slow: tools # some take minutes, on a busy machine several times as long
	@$(RUN) pytest -m slow -o timeout=1800

test-browser: tools # RIG_SCREENSHOTS=FOLDER keeps pictures of the page
	@$(RUN) pytest -m browser -rs tests/web/browser

screenshots: tools
	@mkdir -p build/screenshots
	@RIG_SCREENSHOTS=$(CURDIR)/build/screenshots $(RUN) pytest -m browser -rs tests/web/browser/test_states.py -k screen

pictures: tools
	@$(BIN)/python docs/readme_pictures.py
	@RIG_SCREENSHOTS=$(CURDIR)/docs $(RUN) pytest -m browser -rs tests/web/browser/test_page_picture.py

tracks: install
	@$(BIN)/python docs/page_tracks.py

slidermaps: install
	@$(BIN)/python docs/page_slider_maps.py

check: tools
	@$(RUN) ruff format --check .
	@$(RUN) ruff check .
	@$(BIN)/python tests/order.py
	@$(BIN)/lint-imports
	@$(RUN) mypy

bench: tools
	@$(RUN) benchmarks $(if $(AGAINST),--against $(AGAINST)) $(if $(LOOP),--loop $(LOOP))

docs: install
	@$(BIN)/rig tool reproduce all --out build/gallery --force
	@cp build/gallery/*.png build/gallery/*.svg build/gallery/numbers.json docs/gallery

tables: tools # the figures go to docs, and the page peers.md; what else is measured goes to build/tables
	@rm -rf build/tables
	@mkdir -p build/tables
	@$(RUN) benchmarks --json build/tables/benchmarks.json > build/tables/benchmarks.txt || [ $$? -eq 1 ]
	@$(BIN)/rig cost pendulum --target 1e-6 --budget 40% --out build/tables/cost --force
	@$(BIN)/rig explain brake_shunt -p shunt.connected=true --measure --figure docs/effects.png --force
	@$(BIN)/rig tool torture --out build/tables/torture --force
	@cp build/tables/cost/pendulum-*/cost.png docs/cost.png
	@cp build/tables/torture/matrix.png docs/torture.png
	@$(BIN)/python tests/peers/page.py

lessons: install
	@$(BIN)/python -c "from rig.lessons import lessons, renew; [renew(one) for one in lessons()]"

site: $(VENV)/.installed-site # every warning is an error: a link that leads nowhere, a page in no table of contents
	@$(RUN) sphinx --quiet --fail-on-warning --keep-going --nitpicky -c docs/site docs build/site
	@echo "open build/site/index.html"

$(VENV)/.installed-site: $(VENV)/.installed-tools requirements-site.lock
	@echo "installing Sphinx into $(VENV), beside the packages of requirements-dev.lock, which the pages need too (once)"
	@$(PIP) --require-hashes -r requirements-site.lock
	@touch $@

golden: install # by the commands in the table of recordings/README.md
	@rm -f recordings/golden/*.mcap
	@PATH="$(abspath $(BIN)):$$PATH" sh -exc "$$(sed -n 's/^| `golden.*`\(rig .*\)` |$$/\1/p' recordings/README.md)"
	@for file in recordings/golden/*.mcap; do $(BIN)/rig verify $$file || exit 1; done

proto:
	protoc --proto_path=rig/bus --python_out=rig/bus rig.proto viewing.proto
	protoc --proto_path=rig/record --python_out=rig/record foxglove/Log.proto

LOCK := uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate --fork-strategy fewest
lock:
	$(LOCK) --extra cluster --extra data --extra fmi --extra gym --extra measurements --extra remote --extra view --extra web --group dev --group build pyproject.toml -o requirements-dev.lock
	$(LOCK) --constraint requirements-dev.lock --extra view --extra web --group build pyproject.toml -o requirements.lock
	$(LOCK) --constraint requirements-dev.lock --group site -o requirements-site.lock

uninstall: # what this project has stored for this user, then what it has installed here; the recordings stay
	@[ ! -x $(BIN)/rig ] || $(BIN)/rig tool clean
	@rm -rf $(VENV)

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis build dist
