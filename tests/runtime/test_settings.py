"""Sections of settings: read from environment and flags, typed, refused with one sentence."""

from argparse import ArgumentParser
from dataclasses import dataclass
from ipaddress import ip_network
from pathlib import Path
from typing import ClassVar

import pytest

from linked_fleet_base.settings import (
    FILE,
    NETWORKS,
    ON_OFF,
    PORT,
    PORTS,
    TEXTS,
    Kind,
    Network,
    Section,
    choice,
    read,
    section,
    setting,
    whole_number,
)


@dataclass(frozen=True)
class Lamp(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_LAMP_"

    port: int = setting(PORT, "80", "its port, 100 % of the time")
    most: int = setting(whole_number(1, 9), "3", "at most so many")
    share: float = setting(Kind(float, "a number"), "0.5", "its share")
    lit: bool = setting(ON_OFF, "off", "on or off")
    colour: str = setting(choice("red", "green.ish"), "red", "red or green.ish")
    names: tuple[str, ...] = setting(TEXTS, "", "names")
    near: tuple[Network, ...] = setting(NETWORKS, "", "networks")
    doors: tuple[range, ...] = setting(PORTS, "80,90-99", "ports")
    file: Path | None = setting(FILE, "", "its file")
    url: str = setting(choice("", "a:"), "", "its URL", "LAMP_URL")


@dataclass(frozen=True)
class Fan(Section):
    prefix: ClassVar[str] = "ACME_FAN_"

    speed: int = setting(whole_number(), "1", "its speed")


def lamp(environment: dict[str, str] | None = None, *arguments: str) -> Lamp:
    return section(read([Fan, Lamp], environment or {}, arguments, ArgumentParser()), Lamp)


def test_values_have_the_types_of_their_fields() -> None:
    assert lamp() == Lamp() == Lamp(
        80, 3, 0.5, False, "red", (), (), (range(80, 81), range(90, 100)), None, ""
    )  # fmt: skip
    given = lamp(
        {"LINKED_FLEET_LAMP_LIT": "on", "LINKED_FLEET_LAMP_NAMES": "a, b,,", "LAMP_URL": "a:"},
        *("--lamp-near", "10.0.0.1,fd00::/8", "--lamp-file", "x/y", "--lamp-share", "2e-1", "--lamp-doors", ""),
    )
    assert (given.lit, given.names, given.url) == (True, ("a", "b"), "a:")
    assert given.near == (ip_network("10.0.0.1/32"), ip_network("fd00::/8"))
    assert (given.file, given.share, given.doors) == (Path("x/y"), 0.2, ())


def test_flags_win_over_the_environment_and_an_empty_variable_is_none() -> None:
    environment = {"LINKED_FLEET_LAMP_PORT": "81", "LINKED_FLEET_LAMP_MOST": ""}
    assert (lamp(environment).port, lamp(environment).most) == (81, 3)
    assert lamp(environment, "--lamp-port", "82").port == 82


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("PORT", "0", "LINKED_FLEET_LAMP_PORT is a port number from 1 to 65535, not '0'"),
        ("PORT", "65536", "LINKED_FLEET_LAMP_PORT is a port number from 1 to 65535, not '65536'"),
        ("PORT", " 80", "LINKED_FLEET_LAMP_PORT is a port number from 1 to 65535, not ' 80'"),
        ("PORT", "8.0", "LINKED_FLEET_LAMP_PORT is a port number from 1 to 65535, not '8.0'"),
        ("PORT", "٨", "LINKED_FLEET_LAMP_PORT is a port number from 1 to 65535, not '٨'"),
        ("MOST", "9" * 5000, "LINKED_FLEET_LAMP_MOST is a whole number from 1 to 9, not '999"),
        ("SHARE", "half", "LINKED_FLEET_LAMP_SHARE is a number, could not convert string to float: 'half'"),
        ("LIT", "yes", "LINKED_FLEET_LAMP_LIT is on or off, not 'yes'"),
        ("COLOUR", "greenXish", "LINKED_FLEET_LAMP_COLOUR is red or green.ish, not 'greenXish'"),
        ("NEAR", "10.0.0.0/8,x.y", "LINKED_FLEET_LAMP_NEAR is of networks such as 10.0.0.0/8, and 'x.y' does not"),
        ("NEAR", "10.0.0.1/8", "LINKED_FLEET_LAMP_NEAR is of networks such as 10.0.0.0/8, and 10.0.0.1/8 has host"),
        ("DOORS", "80,9-8", "LINKED_FLEET_LAMP_DOORS is of ports such as 443 or 8000-8999, not '9-8'"),
        ("DOORS", "1-65536", "LINKED_FLEET_LAMP_DOORS is of ports such as 443 or 8000-8999, not '1-65536'"),
    ],
)  # fmt: skip
def test_invalid_settings_are_refused_in_one_sentence(name: str, text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match="LINKED") as refused:
        lamp({f"LINKED_FLEET_LAMP_{name}": text})
    assert str(refused.value).startswith(sentence)


def test_flags_of_others_are_refused_unless_there_are_others(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        lamp({}, "--moon", "full")
    assert "unrecognized arguments: --moon full" in capsys.readouterr().err
    (fan,) = read([Fan], {}, ["--moon", "full", "--acme-fan-speed", "2"], ArgumentParser(), others=True)
    assert fan == Fan(2)


def test_the_help_names_variables(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        lamp({}, "--help")
    said = " ".join(capsys.readouterr().out.split())
    assert "--lamp-port LAMP_PORT its port, 100 % of the time (LINKED_FLEET_LAMP_PORT)" in said
    assert "--lamp-url LAMP_URL its URL (LAMP_URL)" in said


def test_a_variable_belongs_to_one_section() -> None:
    @dataclass(frozen=True)
    class Other(Section):
        lamp_port: int = setting(PORT, "80", "its port")

    with pytest.raises(ValueError, match="LINKED_FLEET_LAMP_PORT is a setting of both Lamp and Other"):
        read([Lamp, Other], {}, [], ArgumentParser())


def test_a_section_that_was_not_read_is_none() -> None:
    with pytest.raises(LookupError, match="Fan"):
        section([Lamp()], Fan)
