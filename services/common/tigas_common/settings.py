"""How every service is configured: default < file < environment < command-line flag."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import typer
from pydantic import AfterValidator, BeforeValidator, ValidationError
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from tigas_common.address import Address
from tigas_common.hosts import host_of, host_of_origin
from tigas_common.http_limits import HttpLimits

FILE_VARIABLE = "TIGAS_CONFIG"
"""Names the settings file; without it, `tigas.toml` in the working directory is read if it is there."""
MODELS = Path("models")
"""The models directory, unless another is named: in the working directory, where it is made if it is missing."""


def _address(value: Any) -> Any:
    return Address.parse(value) if isinstance(value, str) else value


def _address_or_off(value: Any) -> Any:
    return None if value == "off" else _address(value)


def _host(value: str) -> str:
    if host_of(value) != value.lower():
        raise ValueError(f"{value!r} is not a host name, such as tigas.example.org")
    return value.lower()


def _page(value: str) -> str:
    page = value.lower().removesuffix("/")
    if host_of_origin(page) is None:
        raise ValueError(f"{value!r} is not a page's origin, such as https://tigas.example.org")
    return page


# NoDecode: what the environment holds is HOST:PORT, not JSON.
Listen = Annotated[Address, NoDecode, BeforeValidator(_address)]
"""A setting that is an address, written HOST:PORT."""
ListenOrOff = Annotated[Address | None, NoDecode, BeforeValidator(_address_or_off)]
"""An address, or `off` for None."""
Origins = tuple[Annotated[str, AfterValidator(_page)], ...]
"""Pages, as browsers name them in `Origin`."""

Settings = TypeVar("Settings", bound="ServiceSettings")


class ServiceSettings(BaseSettings):
    """Settings of one service. Subclasses set `env_prefix`, and `table`, their table in the settings file."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    table: ClassVar[str] = ""

    http_limits: HttpLimits = HttpLimits()
    """Limits on HTTP/1.1 connections; a table of their own in the settings file, JSON in the environment."""
    allow_hosts: tuple[Annotated[str, AfterValidator(_host)], ...] = ()
    """Names that the service answers under, beside addresses and names that only the own network gives."""
    allow_origins: Origins = ()
    """Pages of other hosts that may use the service and show it in a frame."""

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
    """A table of the settings file; nothing if there is neither the file nor the table."""
    named = os.environ.get(FILE_VARIABLE)
    path = Path(named or "tigas.toml")
    if named and not path.is_file():  # the library would take it for an empty one
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), named)
    try:
        return (TomlConfigSettingsSource(model, path, toml_table_header=(table,)),)
    except KeyError:  # the file configures other services
        return ()
    except AttributeError:
        raise ValueError(f"[{table}] is not a table") from None


def load_settings(model: type[Settings], flags: dict[str, Any]) -> Settings:
    """Settings from file, environment and the flags that were given (those that are neither None nor empty).

    Raises typer.BadParameter with one sentence if a value is wrong.
    """
    try:
        return model(**{name: value for name, value in flags.items() if value not in (None, [])})
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        name = ".".join(map(str, first["loc"]))
        raise typer.BadParameter(f"{name}: {first['msg'].removeprefix('Value error, ')}") from None
    except (OSError, ValueError) as error:
        raise typer.BadParameter(f"the settings file cannot be read: {error}") from None
