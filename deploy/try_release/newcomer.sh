#!/usr/bin/env bash
# A newcomer's first steps in an empty container of Debian or Ubuntu, timed. Run by "make try-release".
# /dist has the files of a release, /source.tar the checkout. Prints a line for each step: held or failed, seconds, step.
set -euo pipefail

export DEBIAN_FRONTEND=noninteractive PIP_FIND_LINKS=/dist UV_FIND_LINKS=/dist PATH=$HOME/.local/bin:$PATH
export PIP_DISABLE_PIP_VERSION_CHECK=1
wheel=$(echo /dist/linked_fleet-*.whl)
root=http://127.0.0.1:8000/
mkdir -p /tmp/newcomer && cd /tmp/newcomer

step() { # step NAME FUNCTION: bash ignores -e in a function that is part of a condition, so its status is read here
  local begin status log="/tmp/newcomer/$2.log"
  begin=$(date +%s%N)
  set +e
  (set -e; "$2") > "$log" 2>&1
  status=$?
  set -e
  local tenths=$((($(date +%s%N) - begin) / 100000000))
  if [ "$status" != 0 ]; then
    tail -n 60 "$log" >&2
    printf 'failed %5s.%s s  %s\n' $((tenths / 10)) $((tenths % 10)) "$1"
    exit 1
  fi
  printf 'held   %5s.%s s  %s\n' $((tenths / 10)) $((tenths % 10)) "$1"
}

awaited() { # awaited SECONDS COMMAND…: repeat the command until it succeeds
  local deadline=$(($(date +%s) + $1))
  shift
  until "$@"; do
    [ "$(date +%s)" -lt "$deadline" ] || { echo "never: $*"; return 1; }
    sleep 0.2
  done
}

online() { # online COUNT: succeed if COUNT robots are online
  local found
  found=$(curl -sf -H 'Accept: application/n-triples' "$root" | grep -c 'linked-fleet#presence> <https://w3id.org/linked-fleet#online>') || true
  [ "$found" = "$1" ]
}

ended() { # ended PROCESS: end it by Ctrl-C, and check that none of its processes is left
  kill -INT -- "-$1"
  wait "$1" || true
  awaited 30 gone "$root"
  awaited 30 none_left
}

none_left() { # also of sessions of their own, in which workers and the embedded server run
  ! grep -qs 'linked[_-]fleet' /proc/[0-9]*/cmdline
}

gone() { ! curl -sf -o /dev/null "$1"; }

demo() { # demo COMMAND…: wait until six robots are online, then end it
  set -m
  "$@" &
  local process=$!
  awaited 600 online 6
  ended "$process"
}

named() { # print the packages of the system that the pages tell a reader to install
  tar -xOf /source.tar README.md docs/TUTORIAL.md | grep -oP '(?<=sudo apt install )[a-z0-9 .+-]+' | xargs -n 1 | sort -u
}

packages() { # not what they recommend, such as a compiler, which brings libgomp1; only images lack ca-certificates
  apt-get update -qq
  # shellcheck disable=SC2046 # a word for each package
  apt-get install -qqy --no-install-recommends ca-certificates $(named)
}

by_pipx() { demo pipx run --spec "$wheel" linked-fleet demo; }

by_uv() {
  pipx install uv
  demo uvx linked-fleet demo
}

by_uv_again() { demo uvx linked-fleet demo; }

agent() {
  python3 -m venv robot
  robot/bin/pip install linked-fleet-agent
  robot/bin/pip list --format freeze | grep -vE '^(pip|setuptools|wheel)=' | tee packages.txt
  [ "$(wc -l < packages.txt)" = 3 ]
  robot/bin/linked-fleet-agent --help
}

installed() {
  pipx install "$wheel"
  linked-fleet --help
  linked-fleet doctor
}

own_robot() { # run examples/door.py with files instead of devices
  tar -xOf /source.tar examples/door.py > door.py
  mkdir servo && echo 0 > servo/angle
  set -m
  linked-fleet gateway --zenoh-listen tcp/127.0.0.1:7447 &
  local gateway=$!
  python3 -c '
import pathlib, time
servo = pathlib.Path("servo")
while True:  # the angle of the door follows the servo
    try:
        angle = round((int((servo / "duty_cycle").read_text()) - 1_000_000) / 1_000_000 * 4095)
        (servo / "new").write_text(str(angle))
        (servo / "new").rename(servo / "angle")
    except (OSError, ValueError):
        pass
    time.sleep(0.005)' &
  local servo=$!
  DOOR_PWM=servo DOOR_ANGLE=servo/angle robot/bin/python door.py --connect tcp/127.0.0.1:7447 &
  local door=$!
  awaited 60 online 1
  linked-fleet do door/hinge rotate value=30 unit=deg
  linked-fleet ls door/hinge
  linked-fleet ls door/hinge | grep -E '^rotation .* 0\.52'
  kill "$door" "$servo"
  ended "$gateway"
}

checkout() {
  mkdir checkout && tar -xf /source.tar -C checkout && cd checkout
  demo make demo
}

tutorial() {
  cd checkout
  set -m
  make demo &
  local process=$!
  awaited 300 online 6
  awaited 60 curl -sf -o /dev/null "${root}health/ready"
  .venv/bin/python tests/support/run_page.py docs/TUTORIAL.md
  ended "$process"
}

step "packages of the system that the pages name: apt install $(named | xargs)" packages
step "pipx run linked-fleet demo, until six robots are online, and Ctrl-C" by_pipx
cp by_pipx.log by_pipx_first.log
step "the same again" by_pipx
step "pipx install uv; uvx linked-fleet demo" by_uv
step "uvx linked-fleet demo again" by_uv_again
step "pip install linked-fleet-agent on a robot: two dependencies" agent
step "pipx install linked-fleet; linked-fleet --help" installed
step "a robot of your own: examples/door.py, turned to 30 degrees" own_robot
step "the tutorial begins: make demo in a checkout, until six robots are online, and Ctrl-C" checkout
step "the tutorial from end to end: make demo, then each of its commands" tutorial
