"""How every service is configured: default < file < environment < command-line flag."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BeforeValidator
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from tigas_common.address import Address, host_of, host_of_origin
from tigas_common.command import NO_FLAG, Metavar
from tigas_common.errors import UsageError
from tigas_common.limits import ServiceHttpLimits

FILE_VARIABLE = "TIGAS_CONFIG"
"""Names the settings file; without it, `tigas.toml` in the working directory is read if it is there."""
WEBVIEW = re.compile("vscode-webview://[0-9a-z-]+")
"""Origin of notebooks in Visual Studio Code."""
MODELS = Path("models")
"""The models directory, unless another is named: in the working directory, where it is made if it is missing."""


def _address(value: Any) -> Any:
    return Address.parse(str(value)) if isinstance(value, str | int | float) else value


def _address_or_off(value: Any) -> Any:
    return None if value in (None, "off") else _address(value)


def _host(value: str) -> str:
    if host_of(value) != value.lower():
        raise ValueError(f"{value!r} is not a host name, such as tigas.example.org")
    return value.lower()


def _page(value: str) -> str:
    page = value.lower().removesuffix("/")
    if host_of_origin(page) is None and not WEBVIEW.fullmatch(page):
        raise ValueError(f"{value!r} is not a page's origin, such as https://tigas.example.org")
    return page


def _base_url(value: str) -> str:
    if not re.fullmatch(r"https?://[^/]+/?", value):
        raise ValueError(f"{value!r} is not a service's URL, such as http://127.0.0.1:8080")
    return value


# NoDecode: the environment has HOST:PORT, not JSON.
Listen = Annotated[Address, NoDecode, BeforeValidator(_address), Metavar("HOST:PORT")]
"""A setting that is an address, written HOST:PORT."""
ListenOrOff = Annotated[Address | None, NoDecode, BeforeValidator(_address_or_off), Metavar("HOST:PORT")]
"""An address, or `off` for None."""
Url = Annotated[str, AfterValidator(_base_url), Metavar("URL")]
"""Base URL of a service."""
HostNames = tuple[Annotated[str, AfterValidator(_host), Metavar("NAME")], ...]
"""Names of hosts."""
Origins = tuple[Annotated[str, AfterValidator(_page), Metavar("URL")], ...]
"""Pages, as browsers name them in `Origin`."""


class ServiceSettings(BaseSettings):
    """Settings of one service. Subclasses set `env_prefix`, and `table`, their table in the settings file."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)
    table: ClassVar[str] = ""

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
        return (init_settings, env_settings, *_from_file(settings_cls, cls.table))


def _from_file(model: type[BaseSettings], table: str) -> tuple[TomlConfigSettingsSource, ...]:
    """A table of the settings file; empty without the file or the table. Raises UsageError."""
    named = os.environ.get(FILE_VARIABLE)
    path = Path(named or "tigas.toml")
    if named and not path.is_file():  # the library would take it for an empty one
        raise UsageError(f"{FILE_VARIABLE}: {path} is no file.")
    try:
        return (TomlConfigSettingsSource(model, path, toml_table_header=(table,)),)
    except KeyError:  # the file configures other services
        return ()
    except AttributeError:
        raise UsageError(f"{path}: {table} is not a table, which begins with [{table}].") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}.") from None
    except ValueError as error:
        raise UsageError(f"{path} is not TOML: {error}.") from None
