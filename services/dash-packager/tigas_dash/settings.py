"""The packager's settings."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.settings import Listen, ServiceSettings
from tigas_common.topology import DASH, PAGE


class DashSettings(ServiceSettings):
    """Each may be set in `tigas.toml` under [dash], as TIGAS_DASH_<NAME>, or as a flag of `tigas dash`."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_DASH_", extra="forbid", frozen=True)
    table: ClassVar[str] = "dash"

    render: str = Field(default=f"http://{PAGE.loopback}", pattern=r"^https?://[^/]+/?$")
    """Where the render service is."""
    http: Listen = DASH.loopback
    """Where streams are served."""
    max_sessions: int = Field(default=4, ge=1, le=1000)
    """How many streams are encoded at a time."""
    idle_s: float = Field(default=15, gt=0, le=86_400)
    """A stream that nobody has watched for so long is ended, in seconds."""
    encoder: Literal["auto", "libx264", "h264_nvenc"] = "auto"
    """`auto` is NVIDIA's where it works."""
