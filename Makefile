# make demo | figures | test | bench | install | lint | clean
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo figures install test test-fast bench lint clean

demo: install
	$(BIN)/ori-deploy demo

# The paper's figures and the data behind them, in out/figures.
figures: install
	$(BIN)/ori-deploy figures --out out/figures

install: $(STAMP)

$(STAMP): pyproject.toml setup.py tools/generate_codecs.py ori_deploy/wire/ori_deploy.xml
	@sh tools/make_venv.sh $(PYTHON) $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

# The fast suite, then what is marked slow.
test: test-fast
	$(BIN)/python -m pytest -q -n 2 -m slow

test-fast: install lint
	$(BIN)/python -m pytest -q -n 2 -m 'not slow'

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: install
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) out build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
