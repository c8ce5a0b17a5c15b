"""The store's settings."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.settings import Listen, ServiceSettings
from tigas_common.topology import PAGE, STORE


class StoreSettings(ServiceSettings):
    """Each can be set in `tigas.toml` under [store], as TIGAS_STORE_<NAME>, or as a flag of `tigas store`."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_STORE_", extra="forbid", frozen=True)
    table: ClassVar[str] = "store"

    results: Path = Path("results")
    """The directory of experiments, one folder each; created if missing."""
    movements: Path = Path("traces/movement")
    """The directory of movement traces."""
    render: str = Field(default=f"http://{PAGE.loopback}", pattern=r"^https?://[^/]+/?$")
    """Base URL of the render service, which samples are rendered by again."""
    http: Listen = STORE.loopback
    """Address of the API."""
