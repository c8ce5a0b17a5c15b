"""JSON Schemas of wire types, from which the page's TypeScript types are generated (`npm run wire`).

Run as a program it prints the schema that its argument names: `python -m tigas_common.wire.schema shaper`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, Literal

from pydantic.json_schema import models_json_schema

from tigas_common.wire import dash, recording, render, shaper, store, webrtc
from tigas_common.wire.model import WireModel


def messages_schema(
    title: str, description: str, *, requests: Sequence[type[Any]], answers: Sequence[type[WireModel]]
) -> dict[str, Any]:
    """An object with one property per message; what a client may leave out of a request is optional in it."""
    validation: Literal["validation"] = "validation"
    serialization: Literal["serialization"] = "serialization"
    references, schema = models_json_schema(
        [*((model, validation) for model in requests), *((model, serialization) for model in answers)]
    )
    messages = {model.__name__: reference for (model, _), reference in references.items()}
    return {
        "title": title,
        "description": description,
        "type": "object",
        "properties": messages,
        "required": list(messages),
        "additionalProperties": False,
        "$defs": {name: _without_field_titles(definition) for name, definition in schema["$defs"].items()},
    }


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each service's messages, by the name of its module here."""
    return {
        "render": messages_schema(
            "Wire",
            "All messages between client and server.",
            requests=[render.RenderRequest],
            answers=[
                render.FrameHeader,
                render.Problem,
                render.SceneInfo,
                render.ServerConfig,
                render.Training,
                render.AddedScene,
            ],
        ),
        "dash": messages_schema(
            "DashWire",
            "All messages between the packager and the page.",
            requests=[dash.SessionRequest, dash.PoseUpdate, webrtc.WebRtcRequest],
            answers=[
                dash.SessionInfo,
                dash.SessionStatus,
                dash.FrameShown,
                webrtc.WebRtcSession,
                webrtc.SentFrame,
            ],
        ),
        "shaper": messages_schema(
            "ShaperWire",
            "All messages between the shaper and the page.",
            requests=[shaper.StartRequest, shaper.SeekRequest, shaper.LoopRequest, shaper.LinkSetting],
            answers=[shaper.TraceList, shaper.TracePoints, shaper.ShaperStatus],
        ),
        "store": messages_schema(
            "StoreWire",
            "All messages between the experiments' store and the page.",
            requests=[
                store.ExperimentRequest,
                store.RunUpload,
                store.InterruptedRun,
                store.SampleIndex,
                recording.Sample,
            ],
            answers=[
                store.ExperimentCreated,
                store.ExperimentList,
                store.Experiment,
                store.RunRow,
                store.SampleList,
                store.Materialisation,
                store.UploadedSamples,
                store.MovementList,
            ],
        ),
    }


def _without_field_titles(definition: dict[str, Any]) -> dict[str, Any]:
    """Pydantic titles every field; a generator would make a named type of each."""
    properties = {
        name: {key: value for key, value in field.items() if key != "title"}
        for name, field in definition.get("properties", {}).items()
    }
    return {**definition, "properties": properties} if properties else definition


if __name__ == "__main__":
    print(json.dumps(schemas()[sys.argv[1]], indent=2))
