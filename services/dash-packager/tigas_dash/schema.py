"""Prints the JSON Schema of the packager's messages, from which the page's types are generated (`npm run wire`)."""

from __future__ import annotations

import json
from typing import Any

from tigas_common.schema import messages_schema
from tigas_dash.wire import FrameShown, PoseUpdate, SessionInfo, SessionRequest, SessionStatus


def dash_schema() -> dict[str, Any]:
    """The messages between the packager and those who watch its streams."""
    return messages_schema(
        "DashWire",
        "All messages between the packager and the page.",
        requests=[SessionRequest, PoseUpdate],
        answers=[SessionInfo, SessionStatus, FrameShown],
    )


if __name__ == "__main__":
    print(json.dumps(dash_schema(), indent=2))
