"""Prints the JSON Schema of the shaper's messages, from which the page's types are generated (`npm run wire`)."""

from __future__ import annotations

import json
from typing import Any

from tigas_common.schema import messages_schema
from tigas_shaper.wire import LinkSetting, LoopRequest, SeekRequest, ShaperStatus, StartRequest, TraceList, TracePoints


def shaper_schema() -> dict[str, Any]:
    """The messages between the shaper and those who watch or change its link."""
    return messages_schema(
        "ShaperWire",
        "All messages between the shaper and the page.",
        requests=[StartRequest, SeekRequest, LoopRequest, LinkSetting],
        answers=[TraceList, TracePoints, ShaperStatus],
    )


if __name__ == "__main__":
    print(json.dumps(shaper_schema(), indent=2))
