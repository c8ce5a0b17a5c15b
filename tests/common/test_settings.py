"""Settings come from flag, environment, file and default, in this order, with clear errors."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from pydantic import BaseModel, Field, TypeAdapter, ValidationError
from pydantic_settings import SettingsConfigDict

from tigas_cluster.settings import ClusterSettings
from tigas_common.command import load, parse
from tigas_common.errors import UsageError
from tigas_common.limits import HttpLimits
from tigas_common.settings import TABLES, ListenOrOff, Origins, ServiceSettings
from tigas_dash.settings import DashSettings
from tigas_experiments.store.settings import StoreSettings
from tigas_render.settings import RenderSettings
from tigas_shaper.settings import ShaperSettings


class Example(ServiceSettings):
    model_config = SettingsConfigDict(env_prefix="TIGAS_EXAMPLE_")
    table: ClassVar[str] = "example"

    a: int = Field(default=1, gt=0)
    b: int = 1
    c: int = 1
    d: int = 1
    at: ListenOrOff = None


def test_flag_beats_environment_beats_file_beats_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tigas.toml").write_text("[example]\nb = 2\nc = 2\nd = 2\n[dash]\nz = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TIGAS_EXAMPLE_C", "3")
    monkeypatch.setenv("TIGAS_EXAMPLE_D", "3")
    settings = parse(Example, "example", ["--d", "4"])
    assert (settings.a, settings.b, settings.c, settings.d) == (1, 2, 3, 4)


def test_settings_are_the_same_in_another_process() -> None:
    settings = parse(Example, "example", ["--a", "5", "--at", "[::1]:8080"])
    assert Example.model_validate_json(settings.model_dump_json()) == settings


def test_a_worker_reads_neither_file_nor_environment_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = parse(Example, "example", ["--a", "5"]).model_dump_json()
    monkeypatch.setattr(ServiceSettings, "are_given", True)
    monkeypatch.setenv("TIGAS_EXAMPLE_B", "many")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tigas.toml").write_text("[example\n")
    settings = Example.model_validate_json(given)
    assert (settings.a, settings.b) == (5, 1)


def test_a_named_file_is_read_instead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.toml").write_text("[example]\na = 7\n")
    monkeypatch.setenv("TIGAS_CONFIG", str(tmp_path / "mine.toml"))
    assert load(Example, {}).a == 7


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"[example]\na = -1\n", r"^\[example\] a: Input should be greater than 0$"),
        (b"[example]\nwheels = 4\n", r"^\[example\] wheels: unknown setting$"),
        (b"[example]\nat = 80\n", r"^\[example\] at: '80' is not HOST:PORT, such as "),
        (b"[example\n", r"mine.toml is not TOML: Expected .*\.$"),
        (b"\xda", r"mine.toml is not TOML: 'utf-8' codec .*\.$"),
        (None, r"^TIGAS_CONFIG: \S+mine.toml is not a file\.$"),
        (
            b"[rendr]\nhttp = 1\n",
            r"mine.toml: unknown table \[rendr\]; the tables are render, dash, shaper, store, cluster\.$",
        ),
        (b"example = 3\n", r"mine.toml: example must be a table, which begins with \[example\]\.$"),
    ],
)
def test_a_wrong_file_is_explained(
    content: bytes | None, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    monkeypatch.setenv("TIGAS_CONFIG", str(path))
    with pytest.raises(UsageError, match=says):
        load(Example, {})


@pytest.mark.parametrize(
    ("variable", "value", "says"),
    [
        ("A", "many", r"^TIGAS_EXAMPLE_A: Input should be a valid integer"),
        ("AT", "80", r"^TIGAS_EXAMPLE_AT: '80' is not HOST:PORT"),
        ("ALLOW_ORIGINS", "https://lab.example", r"^TIGAS_EXAMPLE_ALLOW_ORIGINS is not JSON: "),
        ("ALLOW_ORIGINS", '["lab"]', r"^TIGAS_EXAMPLE_ALLOW_ORIGINS\.0: 'lab' is not a page's origin"),
    ],
)
def test_a_wrong_variable_is_named(variable: str, value: str, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(f"TIGAS_EXAMPLE_{variable}", value)
    with pytest.raises(UsageError, match=says):
        load(Example, {})


@pytest.mark.parametrize(
    ("variable", "says"),
    [
        ("TIGAS_EXAMPLE_ALLOW_HOST", "; did you mean TIGAS_EXAMPLE_ALLOW_HOSTS?"),
        ("TIGAS_EXAMPLE_WHEELS", "."),
        ("TIGAS_EXAMPLE_B", None),
        ("TIGAS_OTHER_WHEELS", None),
    ],
)
def test_a_variable_that_is_no_setting_is_reported(
    variable: str, says: str | None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv(variable, "2")
    load(Example, {})
    reports = [f"The environment variable {variable} is not a setting of this service{says}"] if says else []
    assert caplog.messages == reports


def test_a_file_for_other_services_sets_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tigas.toml").write_text("[dash]\na = 2\n")
    monkeypatch.chdir(tmp_path)
    assert load(Example, {}).a == 1


# -- every service's settings ------------------------------------------------------------------------------------------

SERVICES = (RenderSettings, DashSettings, ShaperSettings, StoreSettings, ClusterSettings)


def test_a_settings_file_has_every_services_table() -> None:
    assert tuple(settings.table for settings in SERVICES) == TABLES


def numbers(model: type[BaseModel]) -> Iterator[tuple[type[BaseModel], str]]:
    """Every field of a model that is a number, and of the models in it."""
    for name, field in model.model_fields.items():
        if field.annotation is float:
            yield model, name
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from numbers(field.annotation)


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1e999"])
@pytest.mark.parametrize("settings", SERVICES)
def test_every_number_is_finite(settings: type[ServiceSettings], value: str) -> None:
    found = list(numbers(settings))
    assert found
    for model, name in found:
        with pytest.raises(ValidationError) as refused:
            TypeAdapter(model).validate_python({name: value})
        assert any(error["loc"] == (name,) for error in refused.value.errors()), name


@pytest.mark.parametrize(
    "url", ["http://127.0.0.1:808O", "http://127.0.0.1:70000", "http://lab:0", "http://a b:1", "ftp://lab"]
)
def test_a_mistyped_url_of_a_service_is_named(url: str) -> None:
    with pytest.raises(ValidationError, match="is not a service's URL"):
        DashSettings(render=url)
    assert DashSettings(render="http://tigas_render:8080/").render == "http://tigas_render:8080/"


def test_limits_are_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tigas.toml").write_text("[dash.http_limits]\nconnections = 3\n[render]\nidle_minutes = 1\n")
    assert HttpLimits.from_settings(load(DashSettings, {}).http_limits) == HttpLimits(connections=3)
    monkeypatch.setenv("TIGAS_RENDER_HTTP_LIMITS", '{"connections": 9}')
    assert HttpLimits.from_settings(load(RenderSettings, {}).http_limits) == HttpLimits(connections=9)


@pytest.mark.parametrize("table", ["http_limits.header_s", "quic_limits.idle_timeout"])
def test_constants_are_no_settings(table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tigas.toml").write_text(f"[render]\n{table} = 3\n")
    with pytest.raises(UsageError, match=rf"^\[render\] {re.escape(table)}: unknown setting"):
        load(RenderSettings, {})


@pytest.mark.parametrize(
    ("page", "origin"),
    [
        ("https://Page.example:8443/", "https://page.example:8443"),
        ("vscode-webview://1a2b-3c", "vscode-webview://1a2b-3c"),
        ("vscode-webview://1a2b/index.html", None),
        ("chrome-extension://abcdef", None),
        ("*", None),
    ],
)
def test_web_pages_and_notebooks_of_visual_studio_code_can_be_allowed(page: str, origin: str | None) -> None:
    allowed: tuple[str | None, ...]
    try:
        allowed = TypeAdapter(Origins).validate_python([page])
    except ValidationError:
        allowed = (None,)
    assert allowed == (origin,)
