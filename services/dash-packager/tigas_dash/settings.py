"""The packager's settings."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.command import NO_FLAG
from tigas_common.settings import Listen, ServiceSettings, Url
from tigas_common.topology import DASH, PAGE


class DashSettings(ServiceSettings):
    """Settings of `tigas dash`: its flags, the table [dash] of `tigas.toml`, and TIGAS_DASH_<NAME>."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_DASH_")
    table: ClassVar[str] = "dash"

    render: Url = f"http://{PAGE.loopback}"
    """Base URL of the render service."""
    http: Listen = DASH.loopback
    """Address of the streams and the API."""
    max_sessions: Annotated[int, NO_FLAG] = Field(default=4, ge=1, le=1000)
    """Maximum number of simultaneous streams."""
    idle_s: Annotated[float, NO_FLAG] = Field(default=15, gt=0, le=86_400)
    """Seconds after which a stream without a viewer is ended."""
    encoder: Annotated[Literal["auto", "libx264", "h264_nvenc"], NO_FLAG] = "auto"
    """Video encoder; `auto` chooses NVIDIA's if it works."""
