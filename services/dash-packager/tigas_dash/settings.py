"""The packager's settings."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.settings import Listen, ServiceSettings
from tigas_common.topology import DASH, PAGE


class DashSettings(ServiceSettings):
    """Each can be set in `tigas.toml` under [dash], as TIGAS_DASH_<NAME>, or as a flag of `tigas dash`."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_DASH_", extra="forbid", frozen=True)
    table: ClassVar[str] = "dash"

    render: str = Field(default=f"http://{PAGE.loopback}", pattern=r"^https?://[^/]+/?$")
    """Base URL of the render service."""
    http: Listen = DASH.loopback
    """Address of the streams and the API."""
    max_sessions: int = Field(default=4, ge=1, le=1000)
    """Maximum number of simultaneous streams."""
    idle_s: float = Field(default=15, gt=0, le=86_400)
    """Streams that nobody watched for this many seconds are ended."""
    encoder: Literal["auto", "libx264", "h264_nvenc"] = "auto"
    """`auto` chooses NVIDIA's encoder if it works."""
