"""How every service is configured: default < file < environment < command-line flag."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import typer
from pydantic import BeforeValidator, ValidationError
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, NoDecode, PydanticBaseSettingsSource, SettingsConfigDict

from tigas_common.address import Address

FILE_VARIABLE = "TIGAS_CONFIG"
"""Names the settings file; without it, `tigas.toml` in the working directory is read if it is there."""


def _address(value: Any) -> Any:
    return Address.parse(value) if isinstance(value, str) else value


def _address_or_off(value: Any) -> Any:
    return None if value == "off" else _address(value)


# NoDecode: what the environment holds is HOST:PORT, not JSON.
Listen = Annotated[Address, NoDecode, BeforeValidator(_address)]
"""A setting that is an address, written HOST:PORT."""
ListenOrOff = Annotated[Address | None, NoDecode, BeforeValidator(_address_or_off)]
"""An address, or `off` for None."""

Settings = TypeVar("Settings", bound="ServiceSettings")


class ServiceSettings(BaseSettings):
    """Settings of one service. Subclasses set `env_prefix`, and `table`, their table in the settings file."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True)
    table: ClassVar[str] = ""

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        return (init_settings, env_settings, _File(settings_cls))


class _File(PydanticBaseSettingsSource):
    """One service's table of the settings file."""

    def get_field_value(self, field: FieldInfo, field_name: str) -> tuple[Any, str, bool]:
        raise NotImplementedError

    def __call__(self) -> dict[str, Any]:
        named = os.environ.get(FILE_VARIABLE)
        path = Path(named or "tigas.toml")
        if named is None and not path.exists():
            return {}
        name = getattr(self.settings_cls, "table", "")
        section = tomllib.loads(path.read_text()).get(name, {})
        if not isinstance(section, dict):
            raise ValueError(f"[{name}] is not a table")  # noqa: TRY004 - the caller explains ValueErrors
        return section


def load_settings(model: type[Settings], flags: dict[str, Any]) -> Settings:
    """Settings from file, environment and the flags that were given (those that are not None).

    Raises typer.BadParameter with one sentence if a value is wrong.
    """
    try:
        return model(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        name = ".".join(map(str, first["loc"]))
        raise typer.BadParameter(f"{name}: {first['msg'].removeprefix('Value error, ')}") from None
    except (OSError, ValueError) as error:
        raise typer.BadParameter(f"the settings file cannot be read: {error}") from None
