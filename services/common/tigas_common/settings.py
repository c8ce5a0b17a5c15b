"""Configuration of every service: default < file < environment < command-line flag."""

from __future__ import annotations

import difflib
import logging
import os
import re
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, ClassVar
from urllib.parse import urlsplit

from pydantic import AfterValidator, BeforeValidator
from pydantic_settings import (
    BaseSettings,
    InitSettingsSource,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from tigas_common.address import Address, parse_host, parse_origin_host
from tigas_common.command import NO_FLAG, Metavar
from tigas_common.errors import UsageError
from tigas_common.limits import ServiceHttpLimits

logger = logging.getLogger(__name__)

FILE_VARIABLE = "TIGAS_CONFIG"
"""Environment variable with the path of the settings file; by default it is `tigas.toml`, if that exists."""
TABLES = ("render", "dash", "shaper", "store", "cluster")
"""The services' tables in the settings file."""
WEBVIEW = re.compile("vscode-webview://[0-9a-z-]+")
"""Origin of notebooks in Visual Studio Code."""
MODELS = Path("models")
"""Default models directory, in the working directory; it is created if missing."""


def _address(value: Any) -> Any:
    return Address.parse(str(value)) if isinstance(value, str | int | float) else value


def _address_or_off(value: Any) -> Any:
    return None if value in (None, "off") else _address(value)


def _host(value: str) -> str:
    if parse_host(value) != value.lower():
        raise ValueError(f"{value!r} is not a host name, such as tigas.example.org")
    return value.lower()


def _page(value: str) -> str:
    page = value.lower().removesuffix("/")
    if parse_origin_host(page) is None and not WEBVIEW.fullmatch(page):
        raise ValueError(f"{value!r} is not a page's origin, such as https://tigas.example.org")
    return page


def _base_url(value: str) -> str:
    base = value.removesuffix("/")
    with suppress(ValueError):
        if parse_origin_host(base) is not None and urlsplit(base).port != 0:
            return value
    raise ValueError(f"{value!r} is not a service's URL, such as http://127.0.0.1:8080")


# NoDecode, as the environment variable is HOST:PORT and not JSON.
Listen = Annotated[Address, NoDecode, BeforeValidator(_address), Metavar("HOST:PORT")]
"""An address setting, written HOST:PORT."""
ListenOrOff = Annotated[Address | None, NoDecode, BeforeValidator(_address_or_off), Metavar("HOST:PORT")]
"""An address, or `off` for None."""
Url = Annotated[str, AfterValidator(_base_url), Metavar("URL")]
"""Base URL of a service."""
HostNames = tuple[Annotated[str, AfterValidator(_host), Metavar("NAME")], ...]
"""Names of hosts."""
Origins = tuple[Annotated[str, AfterValidator(_page), Metavar("URL")], ...]
"""Origins of pages, as browsers send them."""


class ServiceSettings(BaseSettings):
    """Settings of one service. Subclasses set `env_prefix` and `table`, the service's table in the settings file."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)
    table: ClassVar[str] = ""
    are_given: ClassVar[bool] = False
    """Whether this process receives its settings, as workers do, and reads neither file nor environment."""

    http_limits: ServiceHttpLimits = ServiceHttpLimits()
    """Limits on HTTP/1.1 connections; a nested table in the settings file, JSON in the environment."""
    allow_hosts: Annotated[HostNames, NO_FLAG] = ()
    """Host names that the service answers to, in addition to addresses and names of the local network."""
    allow_origins: Annotated[Origins, NO_FLAG] = ()
    """Origins of other hosts' pages that may use the service and embed it."""

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        if ServiceSettings.are_given:
            return (init_settings,)
        _report_unknown_variables(settings_cls)
        return (init_settings, env_settings, InitSettingsSource(settings_cls, _from_file(cls.table)))


def _report_unknown_variables(model: type[BaseSettings]) -> None:
    """Warn about variables with the settings' prefix but an unknown name, perhaps meant for another version."""
    prefix = str(model.model_config["env_prefix"])
    known = {f"{prefix}{name}".upper() for name in model.model_fields}
    for variable in sorted(os.environ):
        if variable.startswith(prefix) and variable not in known:
            guess = difflib.get_close_matches(variable, known, n=1, cutoff=0.85)
            hint = f"; did you mean {guess[0]}?" if guess else "."
            logger.warning("The environment variable %s is not a setting of this service%s", variable, hint)


def _from_file(table: str) -> dict[str, Any]:
    """A table of the settings file; empty if the file or table is missing. Raises UsageError."""
    named = os.environ.get(FILE_VARIABLE)
    path = Path(named or "tigas.toml")
    if not path.is_file():
        if named:
            raise UsageError(f"{FILE_VARIABLE}: {path} is not a file.")
        return {}
    try:
        tables = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}.") from None
    except ValueError as error:
        raise UsageError(f"{path} is not TOML: {error}.") from None
    for name, settings in tables.items():
        if not isinstance(settings, dict):
            raise UsageError(f"{path}: {name} must be a table, which begins with [{name}].")
        if name not in {*TABLES, table}:
            raise UsageError(f"{path}: unknown table [{name}]; the tables are {', '.join(TABLES)}.")
    return dict(tables.get(table, {}))
