"""Prints the JSON Schema of the store's messages, from which the page's types are generated (`npm run wire`)."""

from __future__ import annotations

import json
from typing import Any

from tigas_common.wire.schema import messages_schema
from tigas_experiments.store.wire import (
    Experiment,
    ExperimentCreated,
    ExperimentList,
    ExperimentRequest,
    MovementList,
    RunRow,
    RunUpload,
)


def store_schema() -> dict[str, Any]:
    """The messages between the store and the page."""
    return messages_schema(
        "StoreWire",
        "All messages between the experiments' store and the page.",
        requests=[ExperimentRequest, RunUpload],
        answers=[ExperimentCreated, ExperimentList, Experiment, RunRow, MovementList],
    )


if __name__ == "__main__":
    print(json.dumps(store_schema(), indent=2))
