"""What a render service says of itself to whoever decides where viewers go (`/api/load`)."""

from __future__ import annotations

from pydantic import Field

from tigas_common.wire.model import Entries, Unit, WireModel
from tigas_common.wire.render import ServerConfig


class HostLoad(WireModel):
    """How busy a host is, and what a page needs to come to it."""

    config: ServerConfig
    """As `/config.json`, fitted to the name that the host was asked under. `retry_after_s` says whether it is full."""
    viewers: int = Field(ge=0)
    utilisation: Unit
    """Of what is busiest: its edges, taken together, or its renderer."""
    queue_age_s: float = Field(ge=0)
    """The longest that anything waited anywhere in the last second."""
    scenes: Entries[str]
    """Those that are loaded, by id."""
