# make demo | figures | docs | test | campaign | bench | install | lint | clean
PYTHON ?= python3
VENV := .venv
# Three on two cores: half of the slow tests' time is real time in which motions run.
PYTEST_WORKERS ?= 3
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# The tests' ground station. Without its windows it needs no more than the project has already; what it depends on
# for them (vtk, opencv) is 750 MB.
MAVPROXY := MAVProxy==1.8.75
# Images of containers often forbid Python to keep what it compiled. Commands and tests start by the hundred here.
export PYTHONDONTWRITEBYTECODE :=
# As commands do for themselves: matrices here are small, and workers have use for every processor.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo figures docs install browser-tools firmware-tools test test-fast campaign bench lint clean

demo: install
	$(BIN)/ori-deploy demo

# The paper's figures and the data behind them, in out/figures.
figures: install
	$(BIN)/ori-deploy figures --out out/figures

# The documents as a site, in out/site; their pictures are made first.
docs: install
	sh tools/local_scripts.sh docs/generated
	$(BIN)/python tools/make_doc_pictures.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

install: $(STAMP)

$(STAMP): pyproject.toml setup.py tools/generate_codecs.py ori_deploy/wire/ori_deploy.xml ori_deploy/wire/ori_vehicle.xml
	@sh tools/make_venv.sh $(PYTHON) $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps '$(MAVPROXY)'
	@touch $@

# The fast suite, then what is marked slow.
test: test-fast
	$(BIN)/python tools/run_suite.py $(PYTEST_WORKERS) slow

test-fast: install browser-tools firmware-tools lint
	$(BIN)/python tools/run_suite.py $(PYTEST_WORKERS) 'not slow'

# Chromium, from Debian; without it the page's tests in a browser are skipped.
browser-tools:
	@sh tools/browser_tools.sh

# Compilers and the emulator's library, from Debian; without them the firmware's tests are skipped.
firmware-tools:
	@sh tools/firmware_tools.sh

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The fast suite's properties with other examples than always; every mutant of the firmware; every fault in every
# stage on every backend, then an hour's soak in simulated time. More than an hour.
campaign: install firmware-tools
	$(BIN)/python -m pytest -q -n $(PYTEST_WORKERS) --dist worksteal -m 'not slow' --hypothesis-profile other
	$(MAKE) -C firmware mutate
	$(BIN)/python -m tests.campaign

bench: install browser-tools firmware-tools
	$(BIN)/python -m benchmarks

clean:
	$(MAKE) -C firmware clean
	rm -rf $(VENV) out docs/generated build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
