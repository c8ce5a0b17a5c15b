"""Report of a render service to the director of a cluster (`/api/load`)."""

from __future__ import annotations

from pydantic import Field

from tigas_common.wire.model import Entries, Unit, WireModel
from tigas_common.wire.render import ServerConfig


class HostLoad(WireModel):
    """A host's load, and its configuration for the page."""

    config: ServerConfig
    """Like `/config.json`, for the name under which the host was reached. `retry_after_s` is set if it is full."""
    viewers: int = Field(ge=0)
    utilisation: Unit
    """Utilisation of the busier part: the edges, taken together, or the renderer."""
    queue_age_s: float = Field(ge=0)
    """The longest that anything waited anywhere in the last second."""
    scenes: Entries[str]
    """Ids of loaded scenes."""
