"""Settings come from flag, environment, file and default, in this order, with clear errors."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import pytest
from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.address import Address
from tigas_common.command import load, parse
from tigas_common.errors import UsageError
from tigas_common.settings import ServiceSettings


class Example(ServiceSettings):
    """A service's settings."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_EXAMPLE_")
    table: ClassVar[str] = "example"

    a: int = Field(default=1, gt=0)
    b: int = 1
    c: int = 1
    d: int = 1


def test_flag_beats_environment_beats_file_beats_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tigas.toml").write_text("[example]\nb = 2\nc = 2\nd = 2\n[other]\nz = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TIGAS_EXAMPLE_C", "3")
    monkeypatch.setenv("TIGAS_EXAMPLE_D", "3")
    settings = parse(Example, "example", ["--d", "4"])
    assert (settings.a, settings.b, settings.c, settings.d) == (1, 2, 3, 4)


def test_a_named_file_is_read_instead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.toml").write_text("[example]\na = 7\n")
    monkeypatch.setenv("TIGAS_CONFIG", str(tmp_path / "mine.toml"))
    assert load(Example, {}).a == 7


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[example]\na = -1\n", "a: Input should be greater than 0"),
        ("[example]\nwheels = 4\n", "wheels"),
        ("[example\n", "cannot be read: Expected"),
        (None, "cannot be read: .*No such file or directory: .*mine.toml"),
        ("example = 3\n", r"cannot be read: \[example\] is not a table"),
    ],
)
def test_a_wrong_file_is_explained(
    content: str | None, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_text(content)
    monkeypatch.setenv("TIGAS_CONFIG", str(path))
    with pytest.raises(UsageError, match=says):
        load(Example, {})


def test_a_file_for_other_services_sets_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tigas.toml").write_text("[other]\na = 2\n")
    monkeypatch.chdir(tmp_path)
    assert load(Example, {}).a == 1


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("127.0.0.1:8080", Address("127.0.0.1", 8080)),
        ("[::]:4433", Address("::", 4433)),
        ("localhost:0", Address("localhost", 0)),
    ],
)
def test_addresses_are_read_and_written_alike(text: str, address: Address) -> None:
    assert Address.parse(text) == address
    assert str(address) == text


@pytest.mark.parametrize(
    "text", ["", "8080", "host:", "host:port", "host:70000", "host:-1", ":8080", "host:٣", "host:" + "9" * 5000]
)
def test_a_wrong_address_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"HOST:PORT|no host"):
        Address.parse(text)
