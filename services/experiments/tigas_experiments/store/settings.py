"""The store's settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic_settings import SettingsConfigDict

from tigas_common.command import NO_FLAG
from tigas_common.settings import Listen, ServiceSettings, Url
from tigas_common.topology import PAGE, STORE


class StoreSettings(ServiceSettings):
    """Settings of `tigas store`: its flags, the table [store] of `tigas.toml`, and TIGAS_STORE_<NAME>."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_STORE_")
    table: ClassVar[str] = "store"

    results: Path = Path("results")
    """Directory of experiments, with one folder each; created if missing."""
    movements: Annotated[Path, NO_FLAG] = Path("traces/movement")
    """Directory of movement traces."""
    render: Annotated[Url, NO_FLAG] = f"http://{PAGE.loopback}"
    """Base URL of the render service that pages use, for ground truth."""
    http: Listen = STORE.loopback
    """Address of the API."""
