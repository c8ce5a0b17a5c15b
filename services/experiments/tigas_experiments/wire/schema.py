"""JSON Schema of the store's messages, and the constants that experiments share with the page.

`python -m tigas_experiments.wire.schema store` prints the schema, `constants` the constants, for `npm run wire`.
"""

from __future__ import annotations

import json
import sys
from types import ModuleType
from typing import Any

from tigas_common.wire.schema import messages_schema
from tigas_experiments.wire import figures, movement, recording, run, store


def schema() -> dict[str, Any]:
    """The schema of the store's messages."""
    return messages_schema(
        requests=[
            store.ExperimentRequest,
            store.NextRequest,
            store.RunUpload,
            store.SampleIndex,
            recording.Sample,
        ],
        answers=[
            store.PlanSummary,
            store.ExperimentCreated,
            store.NextRun,
            store.ExperimentList,
            store.Experiment,
            store.RunRow,
            store.SampleList,
            store.Materialisation,
            store.UploadedSamples,
            store.MovementList,
        ],
    )


def constants() -> dict[str, dict[str, Any]]:
    """The constants that the page shares, keyed by the name of their module here."""
    terms = [term._asdict() for term in run.LINK_TERMS]
    return {
        "run": {
            **_constants(run, "PER_VIEW", "DASH", "LOCAL", "MODE_NAMES", "MODES", "DASH_TRANSPORTS", "UNSHAPED"),
            **_constants(run, "SOURCES", "SIDE_MODES", "USUAL_SIDES"),
            "LINK_TERMS": terms,
        },
        "figures": _constants(figures, "INTERACTIVE_MS", "USUAL_INTERVAL_MS", "AGE_EVERY_MS"),
        "movement": _constants(
            movement, "ANCHORS", "UNITS", "COLUMNS", "MAX_DURATION_MS", "MAX_COORDINATE", "QUATERNION_LENGTHS", "VIEW_M"
        ),
    }


def _constants(module: ModuleType, *names: str) -> dict[str, Any]:
    return {name: getattr(module, name) for name in names}


if __name__ == "__main__":
    print(json.dumps({"store": schema, "constants": constants}[sys.argv[1]](), indent=2))
